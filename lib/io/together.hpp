// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

namespace talus::io {

/// The processes that write one file together, each its own rows; alone by default.
struct Together {
    int rank = 0, size = 1;
    const void* communicator = nullptr; ///< points to the MPI_Comm where size > 1
    /// Collective: the words of the lowest rank that has any, "" where none has.
    std::function<std::string(const std::string&)> agree = [](const std::string& words) { return words; };
    /// Collective: rank 0's bytes to all.
    std::function<void(void*, std::size_t)> broadcast = [](void*, std::size_t) {};

    bool alone() const { return size == 1; }
    bool first() const { return rank == 0; }
};

/// Which rows of a column this process has: [first, first + what it gives) of total.
struct Rows {
    std::uint64_t first = 0, total = 0;
    friend bool operator==(const Rows&, const Rows&) = default;
};

/// Collective: runs `step` on every rank. Where it threw on any, all ranks throw, with the words and the exit
/// code of the lowest rank's Error.
void all_or_none(const Together& together, const std::function<void()>& step);

/// Collective: rank 0's text.
std::string from_first(const Together& together, std::string text);

} // namespace talus::io
