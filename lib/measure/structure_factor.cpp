// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/structure_factor.hpp"

#include "base/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

namespace talus::measure {

namespace {

using Index = std::array<int, 3>;

/// One of m and -m for all m of each shell 1..shells, or those `most` of a shell with the smallest hashes.
std::vector<std::vector<Index>> wave_vectors(int shells, std::size_t most) {
    // A shell of radius s has 2 pi s^2 vectors in its half space: visited with a chance that leaves 2 `most`.
    std::vector<std::vector<std::pair<std::uint32_t, Index>>> found(static_cast<std::size_t>(shells));
    const Philox random(6, 0x5b);
    std::uint64_t counter = 0;
    for (int x = 0; x <= shells; ++x)
        for (int y = -shells; y <= shells; ++y)
            for (int z = -shells; z <= shells; ++z, ++counter) {
                if (x == 0 && (y < 0 || (y == 0 && z <= 0)))
                    continue;
                const double length = std::sqrt(double(x * x + y * y + z * z));
                const int shell = static_cast<int>(length + 0.5);
                if (shell > shells)
                    continue;
                const std::uint32_t hash = random.block(counter)[0];
                const double expected = 2 * std::numbers::pi * shell * shell;
                if (hash * 0x1p-32 * expected > 4 * static_cast<double>(most) && expected > 4. * double(most))
                    continue;
                found[static_cast<std::size_t>(shell - 1)].push_back({hash, {x, y, z}});
            }
    std::vector<std::vector<Index>> out;
    for (auto& shell : found) {
        std::sort(shell.begin(), shell.end());
        out.emplace_back();
        for (std::size_t v = 0; v < std::min(most, shell.size()); ++v)
            out.back().push_back(shell[v].second);
    }
    return out;
}

/// Without the checks for infinities that the operator brings along.
std::complex<double> times(const std::complex<double>& a, const std::complex<double>& b) {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

/// exp(-i 2 pi m x) for m = 0, 1, ...; a direct call now and then keeps rounding at 1e-15.
void fill_powers(double x, std::vector<std::complex<double>>& power) {
    const double turn = -2 * std::numbers::pi * x;
    const std::complex<double> step = std::polar(1.0, turn);
    for (std::size_t m = 0; m < power.size(); ++m)
        power[m] = m % 16 == 0 ? std::polar(1.0, static_cast<double>(m) * turn) : times(power[m - 1], step);
}

} // namespace

StructureFactor structure_factor(const PgBox& box, double reach, ThreadTeam& team) {
    StructureFactor out;
    const std::size_t n = box.size();
    if (n == 0)
        return out;
    double diameter = 0, largest = 0;
    for (double r : box.radius) {
        diameter += 2 * r / static_cast<double>(n);
        largest = std::max(largest, r);
    }
    const double unit = 2 * std::numbers::pi * diameter / box.length; // k d of |m| = 1
    const int shells = std::clamp(static_cast<int>(std::floor(reach / unit)), 1, 200);
    const auto vectors =
        wave_vectors(shells, std::max<std::size_t>(12, 4000 / static_cast<std::size_t>(shells)));
    std::vector<Index> all;
    for (const auto& shell : vectors)
        all.insert(all.end(), shell.begin(), shell.end());
    std::vector<double> volume(n);
    double squares = 0;
    bool one_size = true;
    for (std::size_t i = 0; i < n; ++i) {
        volume[i] = std::pow(box.radius[i] / largest, 3);
        squares += volume[i] * volume[i];
        one_size = one_size && box.radius[i] == box.radius[0];
    }

    // Each thread takes some of the vectors and goes through all grains in their order.
    std::vector<double> plain(all.size()), weighted(all.size());
    const auto sum_up = [&](std::size_t begin, std::size_t end) {
        std::array<std::vector<std::complex<double>>, 3> power;
        for (auto& p : power)
            p.resize(static_cast<std::size_t>(shells) + 1);
        std::vector<std::complex<double>> sum(end - begin), weighted_sum(end - begin);
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t k = 0; k < 3; ++k)
                fill_powers(box.position[i][static_cast<int>(k)] / box.length, power[k]);
            for (std::size_t v = begin; v < end; ++v) {
                const Index& m = all[v];
                const auto order = [&](std::size_t k) {
                    const auto p = power[k][static_cast<std::size_t>(std::abs(m[k]))];
                    return m[k] < 0 ? std::conj(p) : p;
                };
                const std::complex<double> term = times(times(order(0), order(1)), order(2));
                sum[v - begin] += term;
                if (!one_size)
                    weighted_sum[v - begin] += volume[i] * term;
            }
        }
        for (std::size_t v = begin; v < end; ++v) {
            plain[v] = std::norm(sum[v - begin]) / static_cast<double>(n);
            weighted[v] = one_size ? plain[v] : std::norm(weighted_sum[v - begin]) / squares;
        }
    };
    const auto threads = static_cast<std::size_t>(team.size());
    const std::size_t part = (all.size() + threads - 1) / threads;
    team.run([&](int thread) {
        const std::size_t begin = std::min(all.size(), part * static_cast<std::size_t>(thread));
        sum_up(begin, std::min(all.size(), begin + part));
    });

    std::size_t v = 0;
    double small = 0, small_count = 0;
    for (const auto& shell : vectors) {
        double k = 0, s = 0, by_volume = 0;
        for (const Index& m : shell) {
            const double here = unit * std::sqrt(double(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]));
            k += here;
            s += plain[v];
            by_volume += weighted[v];
            if (here < 1 || out.s.empty()) {
                small += plain[v];
                ++small_count;
            }
            ++v;
        }
        const double count = static_cast<double>(shell.size());
        out.k_times_diameter.push_back(k / count);
        out.s.push_back(s / count);
        out.s_by_volume.push_back(by_volume / count);
        out.vectors.push_back(shell.size());
    }
    out.small_k = small / small_count;
    out.small_k_error = out.small_k / std::sqrt(small_count);
    return out;
}

} // namespace talus::measure
