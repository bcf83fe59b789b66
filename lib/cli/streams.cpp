// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/streams.hpp"
#include "base/error.hpp"
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <sstream>
#include <sys/stat.h>
#include <unistd.h>

namespace talus::cli {

void guard_standard_streams() {
    for (const int fd : {0, 1, 2}) {
        if (fcntl(fd, F_GETFD) != -1 || errno != EBADF)
            continue;
        // The lowest free number is taken, which is fd. The direction is the wrong one on purpose.
        const int opened = open("/dev/null", (fd == 0 ? O_WRONLY : O_RDONLY));
        if (opened != fd && opened > 2)
            close(opened);
    }
}

std::string finish_stdout() {
    const bool before = std::ferror(stdout) != 0;
    errno = 0;
    if (std::fflush(stdout) != 0 || before || std::ferror(stdout)) {
        const int error = errno;
        std::clearerr(stdout);
        return error ? std::strerror(error) : "not everything could be written";
    }
    // Network file systems report a full disk at close only; a duplicate's close asks them without losing
    // stdout.
    const int copy = dup(STDOUT_FILENO);
    if (copy < 0 || close(copy) != 0)
        return std::strerror(errno);
    return {};
}

void check_input(const std::string& path) {
    struct stat info {};
    if (stat(path.c_str(), &info) != 0)
        throw Error(ExitCode::input_invalid,
                    fmt::format("{}: input file cannot be read: {}", path, std::strerror(errno)));
    if (S_ISDIR(info.st_mode))
        throw Error(ExitCode::input_invalid, fmt::format("{}: input is a directory: name a file", path));
    if (access(path.c_str(), R_OK) != 0)
        throw Error(ExitCode::input_invalid,
                    fmt::format("{}: input file cannot be read: {}", path, std::strerror(errno)));
}

std::string read_text(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    if (!file)
        throw Error(ExitCode::input_invalid,
                    fmt::format("{}: cannot be read; check its name and rights", path));
    return text.str();
}

void check_output(const std::string& path, bool overwrite) {
    struct stat info {};
    if (stat(path.c_str(), &info) == 0) {
        if (!overwrite)
            throw Error(
                ExitCode::output_exists,
                fmt::format("{}: output exists: give --overwrite to replace it, or another name", path));
        if (!S_ISREG(info.st_mode))
            throw Error(ExitCode::run_failed,
                        fmt::format("{}: output is a {}, which cannot be replaced: name a regular file", path,
                                    S_ISDIR(info.st_mode) ? "directory" : "device"));
    }
    const std::filesystem::path parent = std::filesystem::path(path).parent_path();
    const std::string directory = parent.empty() ? std::string(".") : parent.string();
    if (stat(directory.c_str(), &info) != 0 || !S_ISDIR(info.st_mode))
        throw Error(ExitCode::run_failed,
                    fmt::format("{}: output cannot be written: there is no directory {}: make it first", path,
                                directory));
    if (access(directory.c_str(), W_OK | X_OK) != 0)
        throw Error(ExitCode::run_failed, fmt::format("{}: output cannot be written: directory {}: {}", path,
                                                      directory, std::strerror(errno)));
}

void write_file(const std::string& path, const std::string& text) {
    const std::string temporary = fmt::format("{}.tmp{}", path, getpid());
    const auto fail = [&](int error) {
        unlink(temporary.c_str());
        throw Error(ExitCode::run_failed,
                    fmt::format("{}: output cannot be written: {}", path, std::strerror(error)));
    };
    const int fd = open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0)
        fail(errno);
    for (std::size_t sent = 0; sent < text.size();) {
        const ssize_t n = write(fd, text.data() + sent, text.size() - sent);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0) {
            const int error = errno;
            close(fd);
            fail(error);
        }
        sent += static_cast<std::size_t>(n);
    }
    const int synced = fsync(fd) == 0 ? 0 : errno;
    const int closed = close(fd) == 0 ? 0 : errno;
    if (synced || closed)
        fail(synced ? synced : closed);
    if (rename(temporary.c_str(), path.c_str()) != 0)
        fail(errno);
}

} // namespace talus::cli
