// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/plot.hpp"
#include "base/error.hpp"
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <string_view>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace talus::cli {
namespace {

std::string terminal(const std::string& path, int width, int height) {
    const std::string_view name(path);
    if (name.ends_with(".svg"))
        return fmt::format("svg size {},{} dynamic enhanced background rgb 'white' font 'sans,14'", width,
                           height);
    if (name.ends_with(".png"))
        return fmt::format("pngcairo size {},{} enhanced font 'sans,11'", width, height);
    if (name.ends_with(".pdf"))
        return fmt::format("pdfcairo size {}in,{}in enhanced font 'sans,11'", width / 96.0, height / 96.0);
    throw Error(ExitCode::usage, fmt::format("{}: a plot's name must end in .svg, .png or .pdf", path));
}

[[noreturn]] void fail(const std::string& path, const std::string& why) {
    throw Error(ExitCode::run_failed, fmt::format("{}: plot not written: {}", path, why));
}

struct Finished {
    int status = 0;
    std::string output;
};

/// A pipe's two ends, closed when they go out of scope.
struct Pipe {
    std::array<int, 2> ends{-1, -1};
    Pipe() { good = pipe2(ends.data(), O_CLOEXEC) == 0; }
    ~Pipe() { close_end(0), close_end(1); }
    Pipe(const Pipe&) = delete;
    Pipe& operator=(const Pipe&) = delete;
    void close_end(std::size_t k) {
        if (ends[k] >= 0)
            close(ends[k]);
        ends[k] = -1;
    }
    bool good = false;
};

/// Feeds `script` to gnuplot and collects what it prints; both at once, so that neither pipe can fill up and
/// block.
Finished run_gnuplot(const std::string& script, const std::string& path) {
    Pipe in, out;
    if (!in.good || !out.good)
        fail(path, std::strerror(errno));
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, in.ends[0], STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, out.ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, out.ends[1], STDERR_FILENO);
    // -d: the user's own start-up files have no say; a file name, unlike a bare pipe, stops at the first
    // error.
    std::array<std::string, 3> words = {"gnuplot", "-d", "/dev/stdin"};
    std::array<char*, 4> arguments = {words[0].data(), words[1].data(), words[2].data(), nullptr};
    pid_t child = 0;
    const int spawned = posix_spawnp(&child, "gnuplot", &actions, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (spawned != 0)
        fail(path, fmt::format("gnuplot cannot be started ({}): install the package gnuplot-nox",
                               std::strerror(spawned)));
    in.close_end(0);
    out.close_end(1);
    fcntl(in.ends[1], F_SETFL, O_NONBLOCK);

    Finished result;
    std::size_t sent = 0;
    for (bool open = true; open;) {
        std::array<pollfd, 2> wait = {pollfd{out.ends[0], POLLIN, 0}, pollfd{in.ends[1], POLLOUT, 0}};
        if (poll(wait.data(), in.ends[1] >= 0 ? 2 : 1, -1) < 0 && errno != EINTR)
            break;
        if (in.ends[1] >= 0 && wait[1].revents != 0) {
            const ssize_t n = write(in.ends[1], script.data() + sent, script.size() - sent);
            if (n > 0)
                sent += static_cast<std::size_t>(n);
            if (sent == script.size() || (n < 0 && errno != EAGAIN && errno != EINTR))
                in.close_end(1);
        }
        if (wait[0].revents != 0) {
            char buffer[4096];
            const ssize_t n = read(out.ends[0], buffer, sizeof buffer);
            if (n > 0)
                result.output.append(buffer, static_cast<std::size_t>(n));
            else if (n == 0 || errno != EINTR)
                open = false;
        }
    }
    while (waitpid(child, &result.status, 0) < 0 && errno == EINTR) {
    }
    return result;
}

/// gnuplot's complaint on one line, without the picture of the faulty place.
std::string message_of(const std::string& output) {
    const auto at = output.find("line ");
    std::string text = output.substr(at == std::string::npos ? 0 : at);
    for (char& c : text)
        if (c == '\n' || c == '\r' || c == '\t')
            c = ' ';
    while (!text.empty() && text.back() == ' ')
        text.pop_back();
    if (text.size() > 300)
        text.resize(300);
    return text.empty() ? "no message" : text;
}

} // namespace

void check_plot_path(const std::string& output_path) {
    terminal(output_path, 1, 1);
}

std::string gnuplot_quote(const std::string& text) {
    std::string result = "'";
    for (const char c : text) {
        result += c == '\n' ? ' ' : c;
        if (c == '\'')
            result += '\'';
    }
    return result + "'";
}

void gnuplot(const std::string& script_body, const std::string& output_path, int width_px, int height_px) {
    const std::string temporary = fmt::format("{}.tmp{}", output_path, getpid());
    // gnuplot closes its output at the script's end, so its exit status covers the writing.
    const std::string script =
        fmt::format("set terminal {}\nset output {}\n{}\nunset output\n",
                    terminal(output_path, width_px, height_px), gnuplot_quote(temporary), script_body);
    // A gnuplot that dies early must not take this program with it.
    struct sigaction ignore {
    }, previous{};
    ignore.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &ignore, &previous);
    Finished finished;
    try {
        finished = run_gnuplot(script, output_path);
    } catch (...) {
        sigaction(SIGPIPE, &previous, nullptr);
        throw;
    }
    sigaction(SIGPIPE, &previous, nullptr);
    struct stat written {};
    const bool there = stat(temporary.c_str(), &written) == 0 && written.st_size > 0;
    if (!WIFEXITED(finished.status) || WEXITSTATUS(finished.status) != 0 || !there) {
        unlink(temporary.c_str());
        fail(output_path, "gnuplot: " + message_of(finished.output));
    }
    if (rename(temporary.c_str(), output_path.c_str()) != 0) {
        const int error = errno;
        unlink(temporary.c_str());
        fail(output_path, std::strerror(error));
    }
}

} // namespace talus::cli
