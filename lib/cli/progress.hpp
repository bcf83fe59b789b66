// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <string>

namespace talus::cli {

/// Progress on stderr. Modes: auto (a bar on a terminal, else nothing), bar, json (one JSON object per line,
/// at most one a second), none. Call update as often as you like, from one thread.
class Progress {
public:
    /// @throws Error(usage) for an unknown mode.
    Progress(std::string label, const std::string& mode, bool quiet);
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// @param fraction of the work done, 0 to 1.
    void update(double fraction, const std::string& detail = "");
    /// Ends the display: the bar's line is removed. The destructor does it too.
    void finish();

private:
    enum class Mode { none, bar, json };
    using Clock = std::chrono::steady_clock;
    void draw(double fraction, double elapsed, double remaining, const std::string& detail);

    std::string label_;
    Mode mode_ = Mode::none;
    Clock::time_point start_, last_;
    bool drawn_ = false, finished_ = false, complete_ = false;
};

/// Removes a bar that stands on the terminal's last line, before something else is printed to stderr.
void clear_progress_line();

/// "42s", "3m07s", "2h05m", "3d04h".
std::string format_duration(double seconds);

} // namespace talus::cli
