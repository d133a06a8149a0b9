// What the sources and pages refer to is there: pages, headings, and no page that a clone lacks.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "support/source_text.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Whatever may cite a page, but this file.
std::vector<fs::path> citing_files() {
    static const std::set<std::string> kExtensions{".h",  ".cpp", ".cu",   ".py",   ".in",
                                                   ".md", ".txt", ".json", ".cmake"};
    std::vector<fs::path> files;
    for (const char* folder :
         {"src", "apps", "tests", "docs", "examples", "scripts", "configs", "matrices", "cmake"})
        for (const auto& entry : fs::recursive_directory_iterator(kSource / folder))
            if (entry.is_regular_file() && kExtensions.contains(entry.path().extension()) &&
                entry.path().filename() != "test_docs.cpp")
                files.push_back(entry.path());
    for (const auto& entry : fs::directory_iterator(kSource))
        if (entry.path().extension() == ".md") files.push_back(entry.path());
    return files;
}

/// As hosts of repositories make them: lower case, hyphens for spaces, other marks left out.
std::string anchor_of(const std::string& heading) {
    std::string anchor;
    for (const char c : heading) {
        const auto letter = static_cast<unsigned char>(c);
        if (c == ' ')
            anchor += '-';
        else if (std::isalnum(letter) || letter >= 128 || c == '-' || c == '_')
            anchor += static_cast<char>(std::tolower(letter));
    }
    return anchor;
}

/// Of the headings of a page.
const std::set<std::string>& anchors_in(const fs::path& page) {
    static std::map<fs::path, std::set<std::string>> known;
    const auto [at, is_new] = known.try_emplace(page);
    if (!is_new) return at->second;
    std::istringstream lines(contents(page));
    bool code = false;
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("```")) code = !code;
        const std::size_t level = line.find_first_not_of('#');
        if (code || level == 0 || level == std::string::npos || line[level] != ' ') continue;
        at->second.insert(anchor_of(line.substr(level + 1)));
    }
    return at->second;
}

/// Empty, or what is wrong with it. `anchor`: with its '#', or empty.
std::string fault(const fs::path& page, const std::string& anchor) {
    if (!fs::exists(page)) return "no such file";
    if (!anchor.empty() && !anchors_in(page).contains(anchor.substr(1))) return "no such heading";
    return "";
}

TEST(Docs, EveryPageThatIsNamedExists) {
    static const std::regex kPage(R"(\b(docs/[\w/.-]*\w\.md)(#[\w-]+)?)");
    int named = 0;
    for (const fs::path& file : citing_files()) {
        const std::string text = contents(file);
        for (const auto& m : matches(text, kPage)) {
            // A link of a page below docs/ goes out from there; the next test follows it.
            if (m.position() > 0 && text[static_cast<std::size_t>(m.position()) - 1] == '/')
                continue;
            EXPECT_EQ(fault(kSource / m.str(1), m.str(2)), "") << file << ": " << m.str();
            ++named;
        }
    }
    EXPECT_GE(named, 60);
}

TEST(Docs, EveryLinkLeadsSomewhere) {
    static const std::regex kLink(R"(\]\(([^)\s#]*)(#[^)\s]+)?\))");
    int links = 0;
    for (const fs::path& page : citing_files()) {
        if (page.extension() != ".md") continue;
        const std::string text = contents(page);
        for (const auto& m : matches(text, kLink)) {
            if (m.str(1).find("://") != std::string::npos) continue;
            const fs::path target =
                m[1].length() == 0 ? page : (page.parent_path() / m.str(1)).lexically_normal();
            EXPECT_EQ(fault(target, m.str(2)), "") << page << ": " << m.str();
            ++links;
        }
    }
    EXPECT_GE(links, 40);
}

/// What stands in brackets as a paper's key, as those of references.md.
std::set<std::string> keys_in(const std::string& text, const std::regex& pattern) {
    std::set<std::string> keys;
    for (const auto& m : matches(text, pattern)) keys.insert(m.str(1));
    return keys;
}

TEST(Docs, EveryPaperThatIsCitedIsInTheReferences) {
    static const std::regex kEntry(R"(\n- \[([^\]]+)\] )");
    static const std::regex kCited(
        R"(\[([A-Z][a-z]+[0-9]{2}[a-z]?|[A-Z0-9][A-Za-z]*(?:GS|MVS)|TV-SGS|RaDe-GS|PGSR|GOF|ACMM|ACMP|MVSNet)(?:\]|, ))");
    const std::set<std::string> entries = keys_in(contents(kSource / "docs/references.md"), kEntry);
    EXPECT_GE(entries.size(), 40u);
    std::size_t cited = 0;
    for (const fs::path& file : citing_files())
        for (const std::string& key : keys_in(contents(file), kCited)) {
            EXPECT_TRUE(entries.contains(key)) << file << ": [" << key << "]";
            ++cited;
        }
    EXPECT_GE(cited, 60u);
}

// But for tables, and what a program has printed.
TEST(Docs, LinesWrapAt120) {
    for (const fs::path& page : citing_files()) {
        if (page.extension() != ".md" || page.string().find("/tests/") != std::string::npos)
            continue;
        std::istringstream lines(contents(page));
        int number = 0;
        for (std::string line; std::getline(lines, line);) {
            ++number;
            const bool printed = line.starts_with("    ") && line.find("tvsgs") == line.npos;
            if (line.starts_with("|") || printed) continue;
            const auto columns = std::count_if(line.begin(), line.end(), [](char c) {
                return (static_cast<unsigned char>(c) & 0xC0) != 0x80;  // no continuation of UTF-8
            });
            EXPECT_LE(columns, 120) << page << ':' << number;
        }
    }
}

/// The text on one line, without the marks of comments: what is said does not go by its breaks.
std::string unbroken(const fs::path& file) {
    std::istringstream lines(contents(file));
    std::string text;
    for (std::string line; std::getline(lines, line);) {
        const std::size_t begin = line.find_first_not_of(" \t/*#");
        if (begin != std::string::npos) text += line.substr(begin) + ' ';
    }
    return text;
}

// Formulas are cited from pages of ours or from papers, never from a page that no clone holds.
TEST(Docs, NothingIsCitedThatAReaderCannotOpen) {
    static const std::regex kElsewhere(
        R"(\b[Ss]pecification('s|, section|, [0-9]|s, section)|\b[Tt]he specification\b|\b(specification|design), (section )?[0-9]+)");
    for (const fs::path& file : citing_files()) {
        const std::string text = unbroken(file);
        for (const auto& m : matches(text, kElsewhere)) {
            const std::size_t at = static_cast<std::size_t>(m.position());
            ADD_FAILURE()
                << file << ": '" << text.substr(at > 30 ? at - 30 : 0, 80)
                << "': cite a page and a heading of docs/, or a paper of docs/references.md";
        }
    }
}

/// Lines without what stands before and after them, and without empty ones.
std::vector<std::string> trimmed_lines(const std::string& text) {
    std::istringstream in(text);
    std::vector<std::string> lines;
    for (std::string line; std::getline(in, line);) {
        const std::size_t begin = line.find_first_not_of(" \t\r");
        if (begin == std::string::npos) continue;
        lines.push_back(line.substr(begin, line.find_last_not_of(" \t\r") + 1 - begin));
    }
    return lines;
}

/// Whether `excerpt` stands in `file`, line by line and in its order; a line "// ..." of it stands
/// for any number of lines.
bool stands_in(const std::string& excerpt, const std::string& file) {
    const std::vector<std::string> wanted = trimmed_lines(excerpt), lines = trimmed_lines(file);
    auto from = lines.begin();
    for (auto part = wanted.begin(); part != wanted.end();) {
        const auto end = std::find(part, wanted.end(), "// ...");
        const auto at = std::search(from, lines.end(), part, end);
        if (at == lines.end() && part != end) return false;
        from = at + (end - part);
        part = end == wanted.end() ? end : end + 1;
    }
    return !wanted.empty();
}

/// The fenced C++ of a page, each with the last file that the page names above it.
std::vector<std::pair<std::string, std::string>> excerpts_of(const std::string& page) {
    static const std::regex kFile(R"(`((?:src|apps|tests|examples)/[\w/.-]+\.(?:h|cpp|cu))`)");
    std::vector<std::pair<std::string, std::string>> excerpts;
    std::istringstream lines(page);
    std::string file;
    bool ours = false, other = false;
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("```")) {
            const bool opens = !ours && !other;
            ours = opens && line == "```cpp", other = opens && !ours;
            if (ours) excerpts.push_back({file, ""});
        } else if (ours) {
            excerpts.back().second += line + '\n';
        } else if (!other) {
            for (const auto& m : matches(line, kFile)) file = m.str(1);
        }
    }
    return excerpts;
}

TEST(Docs, FilesThatDevelopersAreSentToExist) {
    static const std::regex kFile(R"(`([\w-]+/[\w/.-]+\.(?:h|cpp|cu|md|py|sh|txt))`)");
    int named = 0;
    for (const auto& page : fs::directory_iterator(kSource / "docs/develop")) {
        for (const auto& m : matches(contents(page.path()), kFile)) {
            EXPECT_TRUE(fs::exists(kSource / m.str(1)) || fs::exists(kSource / "src" / m.str(1)))
                << page.path() << ": " << m.str(1);
            ++named;
        }
    }
    EXPECT_GE(named, 60);
}

TEST(Docs, ExcerptsAreOfTheFilesTheyName) {
    const std::map<std::string, std::size_t> pages{
        {"add-a-loss.md", 5}, {"add-a-backbone.md", 5}, {"add-a-mesher.md", 4}};
    for (const auto& [name, fewest] : pages) {
        const auto excerpts = excerpts_of(contents(kSource / "docs/develop" / name));
        EXPECT_GE(excerpts.size(), fewest) << name;
        for (const auto& [file, text] : excerpts)
            EXPECT_TRUE(fs::exists(kSource / file) && stands_in(text, contents(kSource / file)))
                << name << ": not in '" << file << "':\n"
                << text;
    }
}

TEST(Docs, AnExcerptThatDiffersIsFound) {
    const std::string page = "In `src/a.h`:\n\n```cpp\nint b;\n```\n";
    using Excerpts = std::vector<std::pair<std::string, std::string>>;
    EXPECT_EQ(excerpts_of(page), (Excerpts{{"src/a.h", "int b;\n"}}));
    const std::string file = "int a;\n    int b;\n\nint c;\nint d;\n";
    EXPECT_TRUE(stands_in("int b;\nint c;\n", file));
    EXPECT_TRUE(stands_in("int a;\n// ...\nint d;\n", file));
    EXPECT_FALSE(stands_in("int b;\nint e;\n", file));
    EXPECT_FALSE(stands_in("int a;\nint c;\n", file));
    EXPECT_FALSE(stands_in("int d;\n// ...\nint a;\n", file));
    EXPECT_FALSE(stands_in("", file));
}

}  // namespace
}  // namespace tvsgs
