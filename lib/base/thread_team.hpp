// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

namespace talus {

/// A fixed set of threads that run one function together, again and again, with little cost per call (a step
/// of a small scene has several parallel loops of some 50 microseconds each). The calling thread is member 0.
class ThreadTeam {
public:
    /// @param size         number of threads; 0 takes what the process may use
    /// @param serial_below loops shorter than this run on the calling thread: waking the others costs more
    explicit ThreadTeam(int size = 0, std::size_t serial_below = 1500);
    ~ThreadTeam();
    ThreadTeam(const ThreadTeam&) = delete;
    ThreadTeam& operator=(const ThreadTeam&) = delete;

    int size() const { return size_; }

    /// Processors this process may run on (its affinity mask).
    static int available();

    /// Calls body(thread) once on every member; returns when all have. The first exception is rethrown here.
    template <class Body>
    void run(Body&& body) {
        using B = std::remove_reference_t<Body>;
        dispatch([](void* b, int thread) { (*static_cast<B*>(b))(thread); },
                 const_cast<void*>(static_cast<const void*>(&body)));
    }

    /// Length of each of `parts` parts of [0, n) but the last, a multiple of `align`.
    static std::size_t part_size(std::size_t n, std::size_t parts, std::size_t align = 16) {
        return ((n + parts - 1) / parts + align - 1) / align * align;
    }

    /// Cuts [0, n) into one contiguous part per thread (multiples of `align`) and calls body(begin, end,
    /// thread). The cut depends on n and the team's size only; results must not depend on where it lies.
    template <class Body>
    void for_range(std::size_t n, Body&& body, std::size_t align = 16) {
        if (size_ == 1 || n <= align || n < serial_below_) {
            if (n > 0)
                body(std::size_t{0}, n, 0);
            return;
        }
        const std::size_t chunk = part_size(n, static_cast<std::size_t>(size_), align);
        run([&](int thread) {
            const std::size_t begin = std::min(n, chunk * static_cast<std::size_t>(thread));
            const std::size_t end = std::min(n, begin + chunk);
            if (begin < end)
                body(begin, end, thread);
        });
    }

    /// Like for_range, for a loop over n whose parts do work of `size` in all: also parts that are empty are
    /// called, with body(begin, end, last part or not, thread).
    template <class Body>
    void for_parts(std::size_t n, std::size_t size, Body&& body, std::size_t align = 1) {
        if (size_ == 1 || size < serial_below_) {
            body(std::size_t{0}, n, true, 0);
            return;
        }
        const std::size_t chunk = part_size(n, static_cast<std::size_t>(size_), align);
        run([&](int thread) {
            const std::size_t begin = std::min(n, chunk * static_cast<std::size_t>(thread));
            body(begin, std::min(n, begin + chunk), thread == size_ - 1, thread);
        });
    }

private:
    using Function = void (*)(void*, int);
    void dispatch(Function function, void* argument);
    void work(int thread);
    void call(int thread) noexcept;

    int size_;
    std::size_t serial_below_;
    std::vector<std::thread> threads_;
    Function function_ = nullptr;
    void* argument_ = nullptr;
    std::vector<std::exception_ptr> errors_;
    alignas(64) std::atomic<unsigned> generation_{0};
    alignas(64) std::atomic<int> running_{0};
    std::atomic<bool> stop_{false};
};

} // namespace talus
