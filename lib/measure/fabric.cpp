// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/fabric.hpp"

#include "base/error.hpp"
#include "measure/local_order.hpp"
#include "measure/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::measure {

namespace {

constexpr double bin_width = std::numbers::pi / 2 / OverlapDistribution::bins;

double sin_of_bin(std::size_t bin) {
    return std::sin((static_cast<double>(bin) + 0.5) * bin_width);
}

} // namespace

std::vector<ContactVector> contact_vectors(const PgBox& box, const ContactTable& contacts) {
    std::vector<ContactVector> out;
    out.reserve(contacts.size());
    const auto n = static_cast<std::int64_t>(box.size());
    for (std::size_t row = 0; row < contacts.size(); ++row) {
        const auto [first, second] = contacts.pair[row];
        if (first < 0 || second < 0 || first >= n || second >= n)
            throw Error(
                ExitCode::input_invalid,
                fmt::format("contact {}: pair ({}, {}) names a grain outside 0..{}; make the box anew", row,
                            first, second, n - 1));
        const auto i = static_cast<std::size_t>(first), j = static_cast<std::size_t>(second);
        const auto& image = contacts.image[row];
        const Vec3 shift{image[0] * box.length, image[1] * box.length, image[2] * box.length};
        const Vec3 branch = box.position[j] + shift - box.position[i];
        const double distance = norm(branch);
        if (!(distance > 0))
            throw Error(
                ExitCode::input_invalid,
                fmt::format(
                    "contact {}: grains {} and {} have one centre or no finite place; make the box anew", row,
                    first, second));
        const double overlap = box.radius[i] + box.radius[j] - distance;
        if (overlap > 0)
            out.push_back({i, j, branch / distance, distance, overlap});
    }
    return out;
}

Coordination coordination(std::size_t particles, std::span<const ContactVector> contacts, int least) {
    Coordination out;
    out.rattler.assign(particles, 0);
    if (particles == 0)
        return out;
    std::vector<std::vector<std::uint32_t>> partner(particles);
    for (const ContactVector& c : contacts) {
        partner[c.i].push_back(static_cast<std::uint32_t>(c.j));
        partner[c.j].push_back(static_cast<std::uint32_t>(c.i));
    }
    std::vector<int> degree(particles);
    std::vector<std::size_t> queue;
    for (std::size_t i = 0; i < particles; ++i) {
        degree[i] = static_cast<int>(partner[i].size());
        if (degree[i] < least) {
            out.rattler[i] = 1;
            queue.push_back(i);
        }
    }
    while (!queue.empty()) {
        const std::size_t gone = queue.back();
        queue.pop_back();
        for (std::uint32_t p : partner[gone])
            if (!out.rattler[p] && --degree[p] < least) {
                out.rattler[p] = 1;
                queue.push_back(p);
            }
    }
    std::size_t kept_particles = 0, kept_contacts = 0;
    for (std::uint8_t r : out.rattler)
        kept_particles += r ? 0 : 1;
    for (const ContactVector& c : contacts)
        kept_contacts += out.rattler[c.i] || out.rattler[c.j] ? 0 : 1;
    const double n = static_cast<double>(particles);
    out.mean = 2 * static_cast<double>(contacts.size()) / n;
    out.rattler_fraction = 1 - static_cast<double>(kept_particles) / n;
    if (kept_particles > 0)
        out.mean_no_rattlers = 2 * static_cast<double>(kept_contacts) / static_cast<double>(kept_particles);
    return out;
}

double counting_noise_factor() {
    double sum = 0;
    for (std::size_t l = 0; l < OverlapDistribution::bins; ++l)
        sum += 1 / (2 * std::sin(bin_width / 2) * sin_of_bin(l)); // 1 / P(bin l)
    return sum / static_cast<double>(OverlapDistribution::bins);
}

OverlapDistribution overlap_by_polar_angle(std::span<const ContactVector> contacts) {
    OverlapDistribution out;
    if (contacts.empty())
        return out;
    double sum = 0, squares = 0;
    for (const ContactVector& c : contacts) {
        const double theta = std::acos(std::min(1.0, std::abs(c.normal.z)));
        const std::size_t bin = std::min(static_cast<std::size_t>(theta / bin_width), out.bins - 1);
        out.value[bin] += c.overlap;
        ++out.count[bin];
        sum += c.overlap;
        squares += c.overlap * c.overlap;
    }
    for (std::size_t l = 0; l < out.bins; ++l)
        out.value[l] /= sin_of_bin(l);
    const double scale = mean(out.value);
    for (double& v : out.value)
        v /= scale;
    out.relative_standard_deviation = relative_standard_deviation(out.value);
    out.kurtosis = kurtosis(out.value);
    const double n = static_cast<double>(contacts.size()), m = sum / n;
    out.overlap_variation = std::sqrt(std::max(0.0, squares / n - m * m)) / m;
    out.counting_noise =
        std::sqrt(counting_noise_factor() * (1 + out.overlap_variation * out.overlap_variation) / n);
    return out;
}

Fabric fabric(std::span<const ContactVector> contacts) {
    Fabric out;
    if (contacts.empty())
        return out;
    for (const ContactVector& c : contacts)
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                out.tensor[static_cast<std::size_t>(a)][static_cast<std::size_t>(b)] +=
                    c.normal[a] * c.normal[b];
    const double n = static_cast<double>(contacts.size());
    double squares = 0;
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t b = 0; b < 3; ++b) {
            out.tensor[a][b] /= n;
            const double deviator = 7.5 * (out.tensor[a][b] - (a == b ? 1.0 / 3 : 0.0));
            squares += deviator * deviator;
        }
    out.eigenvalue = eigenvalues(out.tensor);
    out.anisotropy = std::sqrt(1.5 * squares);
    out.vertical_excess = out.tensor[2][2] / (0.5 * (out.tensor[0][0] + out.tensor[1][1])) - 1;
    return out;
}

double bond_order_q6(std::span<const ContactVector> contacts) {
    if (contacts.empty())
        return 0;
    Harmonics6 sum{};
    for (const ContactVector& c : contacts) {
        const Harmonics6 y = harmonics6(c.normal);
        for (std::size_t k = 0; k < sum.size(); ++k)
            sum[k] += y[k];
    }
    double squares = 0;
    for (double y : sum)
        squares += y * y;
    return std::sqrt(squares) / static_cast<double>(contacts.size());
}

} // namespace talus::measure
