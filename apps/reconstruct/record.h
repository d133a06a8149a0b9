// OUT/reconstruct.json: the stages of a reconstruction with their command lines.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace tvsgs::reconstruct {

class Record {
public:
    struct Stage {
        std::string name, command;
        bool done = false;
    };

    /// Reads the record in `folder`, if there is one. Throws Error(ExitCode::input) if it is
    /// damaged or not ours.
    explicit Record(const std::filesystem::path& folder);

    bool is_new() const { return is_new_; }            // the folder has no record
    const Stage* find(const std::string& name) const;  // null: not started
    bool is_done(const std::string& name) const;

    // Each writes the file.
    void clear();
    /// Forgets the stage and all that were started after it.
    void start(const std::string& name, const std::string& command);
    void finish(const std::string& name);

private:
    void save() const;

    std::string file_;
    std::vector<Stage> stages_;  // in the order of their starts
    bool is_new_ = true;
};

}  // namespace tvsgs::reconstruct
