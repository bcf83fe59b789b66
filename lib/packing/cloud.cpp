// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/cloud.hpp"

#include "base/error.hpp"
#include "base/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace talus::packing {

namespace {
constexpr int most_attempts = 20000; ///< for one grain
constexpr std::uint32_t none = ~std::uint32_t{0};
} // namespace

std::vector<Vec3> random_cloud(std::span<const double> radius, double length, double top,
                               std::uint64_t seed) {
    const double largest = radius.empty() ? length : *std::max_element(radius.begin(), radius.end());
    const auto cells = [largest](double edge) {
        return std::clamp(static_cast<int>(std::floor(edge / (2 * largest))), 1, 2048);
    };
    const int across = cells(length), high = cells(top);
    std::vector<std::uint32_t> head(static_cast<std::size_t>(across) * static_cast<std::size_t>(across) *
                                        static_cast<std::size_t>(high),
                                    none),
        next(radius.size(), none);
    const auto cell_of = [](double x, double edge, int count) {
        return std::clamp(static_cast<int>(x / edge * count), 0, count - 1);
    };
    const auto index = [&](int x, int y, int z) {
        return (static_cast<std::size_t>(z) * static_cast<std::size_t>(across) +
                static_cast<std::size_t>(y)) *
                   static_cast<std::size_t>(across) +
               static_cast<std::size_t>(x);
    };
    // Cells next to each other along one direction, each once where there are fewer than three.
    const auto neighbours = [](int c, int count, bool periodic, std::array<int, 3>& out) {
        int n = 0;
        for (int d = -1; d <= 1; ++d) {
            int k = c + d;
            if (periodic)
                k = (k + count) % count;
            else if (k < 0 || k >= count)
                continue;
            if (std::find(out.begin(), out.begin() + n, k) == out.begin() + n)
                out[static_cast<std::size_t>(n++)] = k;
        }
        return n;
    };
    std::vector<Vec3> position(radius.size());
    const auto is_free = [&](const Vec3& x, double r) {
        std::array<int, 3> xs{}, ys{}, zs{};
        const int nx = neighbours(cell_of(x.x, length, across), across, true, xs),
                  ny = neighbours(cell_of(x.y, length, across), across, true, ys),
                  nz = neighbours(cell_of(x.z, top, high), high, false, zs);
        for (int a = 0; a < nz; ++a)
            for (int b = 0; b < ny; ++b)
                for (int c = 0; c < nx; ++c)
                    for (std::uint32_t j =
                             head[index(xs[static_cast<std::size_t>(c)], ys[static_cast<std::size_t>(b)],
                                        zs[static_cast<std::size_t>(a)])];
                         j != none; j = next[j]) {
                        Vec3 d = position[j] - x;
                        d.x -= length * std::round(d.x / length);
                        d.y -= length * std::round(d.y / length);
                        const double reach = r + radius[j];
                        if (norm2(d) < reach * reach)
                            return false;
                    }
        return true;
    };
    Philox random(seed, 1);
    for (std::size_t i = 0; i < radius.size(); ++i) {
        int attempt = 0;
        Vec3 x;
        do {
            if (++attempt > most_attempts)
                throw Error(
                    ExitCode::configuration_invalid,
                    fmt::format("sediment.initial_fraction: no room for grain {} of {} at random places: use "
                                "0.3 or less",
                                i, radius.size()));
            x.x = length * random.uniform();
            x.y = length * random.uniform();
            x.z = radius[i] + (top - 2 * radius[i]) * random.uniform();
        } while (!is_free(x, radius[i]));
        position[i] = x;
        std::uint32_t& first =
            head[index(cell_of(x.x, length, across), cell_of(x.y, length, across), cell_of(x.z, top, high))];
        next[i] = first;
        first = static_cast<std::uint32_t>(i);
    }
    return position;
}

} // namespace talus::packing
