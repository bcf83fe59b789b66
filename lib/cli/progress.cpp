// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/progress.hpp"
#include "base/error.hpp"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/ioctl.h>
#include <unistd.h>

namespace talus::cli {
namespace {

std::atomic<bool> bar_stands{false};

std::size_t terminal_width() {
    winsize size{};
    if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col >= 20)
        return size.ws_col;
    return 80;
}

double seconds(std::chrono::steady_clock::duration d) {
    return std::chrono::duration<double>(d).count();
}

} // namespace

void clear_progress_line() {
    if (bar_stands.exchange(false))
        std::fputs("\r\033[K", stderr);
}

std::string format_duration(double s) {
    if (!(s >= 0) || s > 1e9)
        return "?";
    const auto whole = static_cast<long>(std::lround(s));
    if (whole < 60)
        return fmt::format("{}s", whole);
    if (whole < 3600)
        return fmt::format("{}m{:02}s", whole / 60, whole % 60);
    if (whole < 86400)
        return fmt::format("{}h{:02}m", whole / 3600, whole % 3600 / 60);
    return fmt::format("{}d{:02}h", whole / 86400, whole % 86400 / 3600);
}

Progress::Progress(std::string label, const std::string& mode, bool quiet)
    : label_(std::move(label)), start_(Clock::now()), last_(start_) {
    if (mode == "bar" || (mode == "auto" && isatty(STDERR_FILENO)))
        mode_ = Mode::bar;
    else if (mode == "json")
        mode_ = Mode::json;
    else if (mode != "none" && mode != "auto")
        throw Error(ExitCode::usage,
                    fmt::format("progress: found \"{}\", expected auto, bar, json or none", mode));
    if (quiet)
        mode_ = Mode::none;
}

Progress::~Progress() {
    finish();
}

void Progress::update(double fraction, const std::string& detail) {
    if (mode_ == Mode::none || finished_)
        return;
    fraction = std::isfinite(fraction) ? std::clamp(fraction, 0.0, 1.0) : 0.0;
    const auto now = Clock::now();
    const bool end = fraction >= 1 && !complete_;
    const double pause = mode_ == Mode::bar ? 0.1 : 1.0;
    if (!end && seconds(now - last_) < pause)
        return;
    last_ = now;
    complete_ = complete_ || end;
    const double elapsed = seconds(now - start_);
    draw(fraction, elapsed, fraction > 0 ? elapsed * (1 - fraction) / fraction : -1, detail);
}

void Progress::draw(double fraction, double elapsed, double remaining, const std::string& detail) {
    if (mode_ == Mode::json) {
        nlohmann::ordered_json line = {
            {"label", label_}, {"fraction", fraction}, {"elapsed", elapsed}, {"remaining", nullptr}};
        if (remaining >= 0)
            line["remaining"] = remaining;
        if (!detail.empty())
            line["detail"] = detail;
        fmt::print(stderr, "{}\n", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
        std::fflush(stderr);
        return;
    }
    const std::string end =
        fmt::format(" {:3.0f}% {} {}{}", std::floor(100 * fraction), fraction >= 1 ? "took" : "left",
                    fraction >= 1 ? format_duration(elapsed) : format_duration(remaining),
                    detail.empty() ? std::string() : "  " + detail);
    const std::size_t width = terminal_width() - 1;
    const std::size_t room =
        width > label_.size() + end.size() + 3 ? width - label_.size() - end.size() - 3 : 0;
    std::string line = label_;
    if (const std::size_t length = std::min<std::size_t>(room, 40); length >= 5) {
        const auto full = static_cast<std::size_t>(fraction * static_cast<double>(length));
        line += " [" + std::string(full, '#') + std::string(length - full, '.') + "]";
    }
    line += end;
    if (line.size() > width)
        line.resize(width);
    fmt::print(stderr, "\r{}\033[K", line);
    std::fflush(stderr);
    drawn_ = true;
    bar_stands = true;
}

void Progress::finish() {
    if (finished_)
        return;
    finished_ = true;
    if (drawn_) {
        clear_progress_line();
        std::fflush(stderr);
    }
}

} // namespace talus::cli
