// A lock on a folder, against a second process of the same kind.
#pragma once

#include <string>

namespace tvsgs {

/// Locks a folder for this process while it lives.
class FolderLock {
public:
    /// held() is true if another process has the lock.
    explicit FolderLock(const std::string& folder);
    FolderLock(const FolderLock&) = delete;
    FolderLock& operator=(const FolderLock&) = delete;
    ~FolderLock();
    bool held() const { return held_; }

private:
    int lock_ = -1;
    bool held_ = false;
};

}  // namespace tvsgs
