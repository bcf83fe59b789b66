// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <bit>
#include <cmath>
#include <cstdint>

namespace talus {

/// A sum whose value does not depend on the order of its terms: each term is rounded to a multiple of a fixed
/// quantum (a power of two) and added as an integer. So threads may add in any order and a restarted run goes
/// on with the same bits.
class ExactSum {
public:
    ExactSum() = default;
    /// @param scale what the quantum is measured against: quantum = 2^-72 times scale's power of two. Terms
    /// below
    ///              2^-10 of the scale take the short way.
    explicit ExactSum(double scale) : exponent_(std::ilogb(scale) - 72) {
        to_quanta_ = std::ldexp(1.0, -exponent_);
    }

    void add(double term) {
        const double quanta = term * to_quanta_;
        if (std::abs(quanta) < 0x1p62)
            sum_ += static_cast<std::int64_t>(quanta);
        else if (std::abs(quanta) < 0x1p120)
            add_large(quanta);
        else
            overflowed_ = true;
    }
    void add(const ExactSum& other) {
        sum_ += other.sum_;
        overflowed_ = overflowed_ || other.overflowed_;
    }
    /// For vector code: the factor that turns terms into quanta, which are cut to integers, and the sum of
    /// such integers as high 2^32 + low.
    double quanta_per_unit() const { return to_quanta_; }
    void add_quanta(std::int64_t high, std::int64_t low) {
        sum_ += static_cast<__int128>(high) * (std::int64_t{1} << 32) + low;
    }
    void reset() {
        sum_ = 0;
        overflowed_ = false;
    }
    double value() const {
        return overflowed_ ? std::nan("") : std::ldexp(static_cast<double>(sum_), exponent_);
    }

    bool overflowed() const { return overflowed_; }
    void set_overflowed() { overflowed_ = true; }

    /// The integer itself, for checkpoints and for sums over ranks.
    std::int64_t high_bits() const { return static_cast<std::int64_t>(sum_ >> 64); }
    std::int64_t low_bits() const { return static_cast<std::int64_t>(sum_); }
    void set_bits(std::int64_t high, std::int64_t low) {
        sum_ =
            static_cast<__int128>((static_cast<unsigned __int128>(static_cast<std::uint64_t>(high)) << 64) |
                                  static_cast<std::uint64_t>(low));
    }

private:
    /// From 2^62 on a double is a whole number: its mantissa, shifted. (The compiler's own conversion is a
    /// call.)
    void add_large(double quanta) {
        const auto bits = std::bit_cast<std::uint64_t>(quanta);
        const auto mantissa = static_cast<std::int64_t>((bits & 0xfffffffffffffU) | 0x10000000000000U);
        const __int128 size = static_cast<__int128>(mantissa)
                              << (static_cast<int>(bits >> 52 & 0x7ffU) - 1075);
        sum_ += quanta < 0 ? -size : size;
    }

    __int128 sum_ = 0;
    double to_quanta_ = 0x1p72;
    int exponent_ = -72;
    bool overflowed_ = false;
};

} // namespace talus
