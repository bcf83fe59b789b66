// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/thread_team.hpp"

#include <sched.h>
#include <utility>

namespace talus {

namespace {
constexpr int spins_before_sleep = 3000;

/// Waits until `done()` holds: spins first, since the next parallel loop is mostly microseconds away, then
/// sleeps in the kernel on `watched`, so that an oversubscribed machine is not blocked.
template <class Value, class Done>
void wait_until(const std::atomic<Value>& watched, Done done) {
    for (int spin = 0; spin < spins_before_sleep; ++spin) {
        if (done(watched.load(std::memory_order_acquire)))
            return;
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
    }
    for (Value value = watched.load(std::memory_order_acquire); !done(value);
         value = watched.load(std::memory_order_acquire))
        watched.wait(value, std::memory_order_acquire);
}
} // namespace

int ThreadTeam::available() {
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) == 0)
        return std::max(1, CPU_COUNT(&set));
    return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

ThreadTeam::ThreadTeam(int size, std::size_t serial_below)
    : size_(size > 0 ? size : available()), serial_below_(serial_below),
      errors_(static_cast<std::size_t>(size_)) {
    for (int thread = 1; thread < size_; ++thread)
        threads_.emplace_back([this, thread] { work(thread); });
}

ThreadTeam::~ThreadTeam() {
    stop_.store(true, std::memory_order_relaxed);
    generation_.fetch_add(1, std::memory_order_release);
    generation_.notify_all();
    for (auto& thread : threads_)
        thread.join();
}

void ThreadTeam::call(int thread) noexcept {
    try {
        function_(argument_, thread);
    } catch (...) {
        errors_[static_cast<std::size_t>(thread)] = std::current_exception();
    }
}

void ThreadTeam::work(int thread) {
    for (unsigned seen = 0;; ++seen) {
        wait_until(generation_, [seen](unsigned generation) { return generation != seen; });
        if (stop_.load(std::memory_order_relaxed))
            return;
        call(thread);
        if (running_.fetch_sub(1, std::memory_order_acq_rel) == 1)
            running_.notify_one();
    }
}

void ThreadTeam::dispatch(Function function, void* argument) {
    function_ = function;
    argument_ = argument;
    running_.store(size_ - 1, std::memory_order_relaxed);
    generation_.fetch_add(1, std::memory_order_release);
    if (size_ > 1)
        generation_.notify_all();
    call(0);
    wait_until(running_, [](int running) { return running == 0; });
    for (auto& error : errors_)
        if (error)
            std::rethrow_exception(std::exchange(error, nullptr));
}

} // namespace talus
