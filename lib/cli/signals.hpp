// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <exception>

namespace talus::cli {

/// From now on SIGTERM, SIGUSR1 and SIGINT only ask to stop; a second SIGINT ends the program as usual.
void install_stop_handler();

/// Has one of them come since install_stop_handler()? Cheap: one relaxed load.
bool stop_requested();

/// Which one (0: none).
int stop_signal();

/// For programs without checkpoints: thrown to unwind, so that temporary files go; Tool::run exits 128 +
/// signal.
class Stopped : public std::exception {
public:
    explicit Stopped(int signal) : signal_(signal) {}
    int signal() const noexcept { return signal_; }
    const char* what() const noexcept override { return "stopped by a signal"; }

private:
    int signal_;
};

/// @throws Stopped when a stop has been requested.
void throw_if_stop_requested();

} // namespace talus::cli
