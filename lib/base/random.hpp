// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>

namespace talus {

/// Philox4x32-10, the counter-based generator of Salmon, Moraes, Dror & Shaw, "Parallel random numbers: as
/// easy as 1, 2, 3", SC 2011. The value depends on (seed, stream, counter) alone, so any thread can draw any
/// particle's numbers and the order of drawing never matters.
class Philox {
public:
    explicit constexpr Philox(std::uint64_t seed, std::uint64_t stream = 0) : seed_(seed), stream_(stream) {}

    /// Four independent 32-bit words of block `counter`.
    constexpr std::array<std::uint32_t, 4> block(std::uint64_t counter) const {
        std::array<std::uint32_t, 4> c = {lo(counter), hi(counter), lo(stream_), hi(stream_)};
        std::uint32_t k0 = lo(seed_), k1 = hi(seed_);
        for (int round = 0; round < 10; ++round) {
            const std::uint64_t p0 = std::uint64_t{0xD2511F53u} * c[0];
            const std::uint64_t p1 = std::uint64_t{0xCD9E8D57u} * c[2];
            c = {hi(p1) ^ c[1] ^ k0, lo(p1), hi(p0) ^ c[3] ^ k1, lo(p0)};
            k0 += 0x9E3779B9u;
            k1 += 0xBB67AE85u;
        }
        return c;
    }

    /// Two numbers in [0, 1) with 53 random bits each.
    constexpr std::array<double, 2> uniform2(std::uint64_t counter) const {
        const auto b = block(counter);
        return {to_unit(b[0], b[1]), to_unit(b[2], b[3])};
    }

    /// The next number in [0, 1) of this object's own sequence.
    constexpr double uniform() {
        if (left_ == 0) {
            pair_ = uniform2(next_++);
            left_ = 2;
        }
        return pair_[static_cast<std::size_t>(2 - left_--)];
    }

private:
    static constexpr std::uint32_t lo(std::uint64_t v) { return static_cast<std::uint32_t>(v); }
    static constexpr std::uint32_t hi(std::uint64_t v) { return static_cast<std::uint32_t>(v >> 32); }
    static constexpr double to_unit(std::uint32_t a, std::uint32_t b) {
        const std::uint64_t bits = (std::uint64_t{a} << 32 | b) >> 11;
        return static_cast<double>(bits) * 0x1p-53;
    }

    std::uint64_t seed_, stream_, next_ = 0;
    std::array<double, 2> pair_{};
    int left_ = 0;
};

} // namespace talus
