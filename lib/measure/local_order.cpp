// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/local_order.hpp"

#include "search/pairs.hpp"

#include <algorithm>
#include <cmath>

namespace talus::measure {

namespace {

double product(const Harmonics6& a, const Harmonics6& b) {
    double sum = 0;
    for (std::size_t k = 0; k < a.size(); ++k)
        sum += a[k] * b[k];
    return sum;
}

void add(Harmonics6& to, const Harmonics6& what) {
    for (std::size_t k = 0; k < to.size(); ++k)
        to[k] += what[k];
}

/// sqrt(2 (6 - m)! / (6 + m)!) of order m > 0.
std::array<double, 7> order_factors() {
    std::array<double, 7> out{};
    double ratio = 1;
    for (int m = 1; m <= 6; ++m) {
        ratio /= double(6 + m) * double(7 - m);
        out[static_cast<std::size_t>(m)] = std::sqrt(2 * ratio);
    }
    return out;
}

} // namespace

Harmonics6 harmonics6(const Vec3& n) {
    static const std::array<double, 7> factor = order_factors();
    const double z = n.z, s = z * z;
    // P6 and its derivatives
    const std::array<double, 7> legendre{(((231 * s - 315) * s + 105) * s - 5) / 16,
                                         z * ((1386 * s - 1260) * s + 210) / 16,
                                         ((6930 * s - 3780) * s + 210) / 16,
                                         z * (27720 * s - 7560) / 16,
                                         (83160 * s - 7560) / 16,
                                         10395 * z,
                                         10395};
    Harmonics6 out{legendre[0]};
    double real = 1, imaginary = 0; // (x + i y)^m
    for (std::size_t m = 1; m <= 6; ++m) {
        const double next = real * n.x - imaginary * n.y;
        imaginary = real * n.y + imaginary * n.x;
        real = next;
        out[2 * m - 1] = factor[m] * legendre[m] * real;
        out[2 * m] = factor[m] * legendre[m] * imaginary;
    }
    return out;
}

LocalOrder local_order(const PgBox& box, ThreadTeam& team) {
    LocalOrder out;
    const std::size_t n = box.size();
    out.q6.assign(n, 0);
    out.solid_bonds.assign(n, 0);
    out.neighbours.assign(n, 0);
    if (n == 0)
        return out;
    const double largest = *std::max_element(box.radius.begin(), box.radius.end());
    const double reach = std::min(LocalOrder::reach, box.length / (2 * largest)); // boxes of a grain or two
    const auto pairs = search::find_pairs(box.position, box.radius, box.box(), reach, 0.0, team);
    std::vector<Harmonics6> around(n);
    for (const auto& p : pairs) {
        const Vec3 shift{p.image[0] * box.length, p.image[1] * box.length, p.image[2] * box.length};
        const Vec3 branch = box.position[p.j] + shift - box.position[p.i];
        const double distance = norm(branch);
        if (!(distance > 0))
            continue; // two centres in one place: reported by whoever needs the contact's normal
        const Harmonics6 y = harmonics6(branch / distance);
        for (std::uint32_t k : {p.i, p.j}) {
            add(around[k], y);
            ++out.neighbours[k];
        }
    }
    std::vector<double> length(n);
    for (std::size_t i = 0; i < n; ++i) {
        for (double& y : around[i])
            y /= std::max(1, out.neighbours[i]);
        length[i] = std::sqrt(product(around[i], around[i]));
    }
    std::vector<Harmonics6> averaged = around;
    for (const auto& p : pairs) {
        const bool solid =
            product(around[p.i], around[p.j]) > LocalOrder::solid_bond * length[p.i] * length[p.j];
        out.solid_bonds[p.i] += solid ? 1 : 0;
        out.solid_bonds[p.j] += solid ? 1 : 0;
        add(averaged[p.i], around[p.j]);
        add(averaged[p.j], around[p.i]);
    }
    std::size_t crystal = 0;
    for (std::size_t i = 0; i < n; ++i) {
        out.q6[i] = std::sqrt(product(averaged[i], averaged[i])) / (out.neighbours[i] + 1);
        out.mean_q6 += out.q6[i] / static_cast<double>(n);
        crystal += out.solid_bonds[i] >= LocalOrder::solid_bonds_needed ? 1 : 0;
    }
    out.crystal_fraction = static_cast<double>(crystal) / static_cast<double>(n);
    out.distribution = histogram(out.q6, 0.02);
    return out;
}

} // namespace talus::measure
