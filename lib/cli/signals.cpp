// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/signals.hpp"
#include <atomic>
#include <csignal>

namespace talus::cli {
namespace {

std::atomic<int> received{0};
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler may use it");

void on_signal(int signal) {
    received.store(signal, std::memory_order_relaxed);
    if (signal == SIGINT)
        std::signal(SIGINT, SIG_DFL); // whoever presses Ctrl-C twice means it
}

} // namespace

void install_stop_handler() {
    received.store(0, std::memory_order_relaxed);
    struct sigaction action {};
    action.sa_handler = on_signal;
    action.sa_flags = SA_RESTART; // file writing must not see EINTR
    sigemptyset(&action.sa_mask);
    for (const int signal : {SIGTERM, SIGUSR1, SIGINT})
        sigaction(signal, &action, nullptr);
}

bool stop_requested() {
    return received.load(std::memory_order_relaxed) != 0;
}

int stop_signal() {
    return received.load(std::memory_order_relaxed);
}

void throw_if_stop_requested() {
    if (const int signal = stop_signal())
        throw Stopped(signal);
}

} // namespace talus::cli
