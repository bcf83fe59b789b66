// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/atomic_file.hpp"

#include "base/error.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace talus::io {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& path, const std::string& what, int error, const char* cure) {
    throw Error(ExitCode::run_failed, fmt::format("{}: {}: {}; {}", path, what, std::strerror(error), cure));
}

constexpr off_t lock_place = off_t{1} << 62; ///< a byte that no file has

constexpr const char* other_place = "make room or choose another place for the output";

[[noreturn]] void refuse_existing(const std::string& path) {
    throw Error(ExitCode::output_exists,
                fmt::format("{}: exists already; give another name or --overwrite", path));
}

void sync_path(const std::string& name, const std::string& shown, int flags) {
    const int descriptor = ::open(name.c_str(), flags | O_CLOEXEC);
    if (descriptor < 0)
        fail(shown, "cannot be synced to the disk", errno, other_place);
    const int result = ::fsync(descriptor);
    const int error = errno;
    ::close(descriptor);
    if (result != 0 && error != EINVAL && error != EROFS) // some file systems cannot sync a folder
        fail(shown, "cannot be synced to the disk", error, other_place);
}

std::string folder_of(const std::string& path) {
    const fs::path folder = fs::path(path).parent_path();
    return folder.empty() ? "." : folder.string();
}

/// The file behind symbolic links: they stay, what they point to is replaced.
std::string behind_links(const std::string& path) {
    std::error_code ignored;
    if (!fs::is_symlink(fs::symlink_status(path, ignored)))
        return path;
    const fs::path target = fs::weakly_canonical(path, ignored);
    return target.empty() ? path : target.string();
}

} // namespace

std::string partial_path(const std::string& path) {
    return path + ".part";
}

std::string sidecar_path(const std::string& path) {
    const std::string stem = path.ends_with(".h5") ? path.substr(0, path.size() - 3) : path;
    return stem + ".xdmf";
}

AtomicFile::AtomicFile(const std::string& path, bool overwrite)
    : AtomicFile(path, overwrite, Partial::anew) {}

AtomicFile AtomicFile::take_over(const std::string& path, bool overwrite) {
    return {path, overwrite, Partial::as_it_is};
}

AtomicFile::AtomicFile(const std::string& path, bool overwrite, Partial partial)
    : path_(path), target_(behind_links(path)), partial_(partial_path(target_)), overwrite_(overwrite) {
    std::error_code error;
    const auto status = fs::status(target_, error);
    if (fs::exists(status) && !overwrite)
        refuse_existing(path);
    if (fs::exists(status) && !fs::is_regular_file(status))
        throw Error(
            ExitCode::run_failed,
            fmt::format("{}: is no regular file and cannot be replaced by one; choose another output", path));
    for (;;) { // until the locked file is the one the name points to
        const int create = partial == Partial::anew ? O_CREAT : 0;
        lock_ = ::open(partial_.c_str(), O_RDWR | create | O_CLOEXEC, 0666);
        if (lock_ < 0 && create == 0)
            throw Error(ExitCode::input_invalid,
                        fmt::format("{}: cannot be gone on with: {}; put it back, or start anew", partial_,
                                    std::strerror(errno)));
        if (lock_ < 0)
            fail(path, "cannot be created", errno, "check that the folder exists and is writable");
        struct flock lock {};
        lock.l_type = F_WRLCK;
        lock.l_whence = SEEK_SET;
        lock.l_start = lock_place; // MPI libraries lock what they write on some file systems
        lock.l_len = 1;
        if (::fcntl(lock_, F_OFD_SETLK, &lock) != 0 && (errno == EAGAIN || errno == EACCES)) {
            ::close(std::exchange(lock_, -1));
            throw Error(
                ExitCode::run_failed,
                fmt::format("{}: another program is writing it ({}); wait for it or choose another output",
                            path, partial_));
        }
        struct stat mine {
        }, named{};
        if (::fstat(lock_, &mine) == 0 && ::stat(partial_.c_str(), &named) == 0 &&
            mine.st_ino == named.st_ino && mine.st_dev == named.st_dev)
            break;
        ::close(std::exchange(lock_, -1));
    }
    if (partial == Partial::anew && ::ftruncate(lock_, 0) != 0) { // what a killed run left
        const int reason = errno;
        abandon();
        fail(path, "cannot be created", reason, other_place);
    }
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)), target_(std::move(other.target_)), partial_(std::move(other.partial_)),
      overwrite_(other.overwrite_), lock_(std::exchange(other.lock_, -1)) {}

AtomicFile::~AtomicFile() {
    abandon();
}

std::uint64_t AtomicFile::length() const {
    struct stat status {};
    if (::fstat(lock_, &status) != 0)
        fail(path_, "cannot be measured", errno, other_place);
    return static_cast<std::uint64_t>(status.st_size);
}

void AtomicFile::reserve(std::uint64_t end) {
    const auto present = static_cast<off_t>(length()), room = static_cast<off_t>(end) - present;
    if (room <= 0)
        return;
    int result = 0;
    do
        result = ::fallocate(lock_, FALLOC_FL_KEEP_SIZE, present, room);
    while (result != 0 && errno == EINTR);
    if (result != 0 && errno != EOPNOTSUPP && errno != ENOSYS)
        fail(path_, "cannot be written", errno, other_place);
}

void AtomicFile::sync() const {
    if (::fsync(lock_) != 0 && errno != EINVAL && errno != EROFS)
        fail(path_, "cannot be synced to the disk", errno, other_place);
}

void AtomicFile::abandon() noexcept {
    if (lock_ < 0)
        return;
    ::unlink(partial_.c_str());
    ::close(std::exchange(lock_, -1));
}

void AtomicFile::leave() noexcept {
    if (lock_ >= 0)
        ::close(std::exchange(lock_, -1));
}

void AtomicFile::commit(const std::string& keep_previous) {
    sync_path(partial_, path_, O_RDONLY);
    if (!keep_previous.empty()) {
        // A second name for the present file, put in place by renaming: target_ exists at every instant.
        const std::string second = partial_path(keep_previous);
        ::unlink(second.c_str());
        if (::link(target_.c_str(), second.c_str()) == 0) {
            if (::rename(second.c_str(), keep_previous.c_str()) != 0)
                fail(keep_previous, "cannot be kept", errno, other_place);
            ::unlink(second.c_str()); // where both names were the same file already, rename() left it
        } else if (errno != ENOENT && ::rename(target_.c_str(), keep_previous.c_str()) != 0) {
            fail(keep_previous, "cannot be kept", errno, other_place); // no hard links here, and no renaming
        }
    }
    const bool done = overwrite_ ? ::rename(partial_.c_str(), target_.c_str()) == 0 : rename_to_new();
    if (!done) {
        if (errno == EEXIST)
            refuse_existing(path_);
        fail(path_, "cannot be renamed to its final name", errno, other_place);
    }
    ::close(std::exchange(lock_, -1));
    sync_path(folder_of(target_), path_, O_RDONLY | O_DIRECTORY);
}

/// Renames only where no file of the final name has come up meanwhile.
bool AtomicFile::rename_to_new() const {
    if (::renameat2(AT_FDCWD, partial_.c_str(), AT_FDCWD, target_.c_str(), RENAME_NOREPLACE) == 0)
        return true;
    if (errno != EINVAL && errno != ENOSYS)
        return false;
    if (::access(target_.c_str(), F_OK) == 0) { // a file system without that call
        errno = EEXIST;
        return false;
    }
    return ::rename(partial_.c_str(), target_.c_str()) == 0;
}

void write_text_file(const std::string& path, std::string_view content, bool overwrite) {
    AtomicFile file(path, overwrite);
    file.write(content);
    file.commit();
}

void AtomicFile::write(std::string_view content) {
    while (!content.empty()) {
        const ssize_t put = ::write(lock_, content.data(), content.size());
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            fail(path_, "cannot be written", put < 0 ? errno : ENOSPC, other_place);
        content.remove_prefix(static_cast<std::size_t>(put));
    }
}

} // namespace talus::io
