// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/seam.hpp"

#include "measure/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace talus::measure {

namespace {

std::size_t wrapped(std::int64_t slab, std::size_t slabs) {
    const auto n = static_cast<std::int64_t>(slabs);
    return static_cast<std::size_t>((slab % n + n) % n);
}

SlabProfile slab_profile(const PgBox& box, std::span<const ContactVector> contacts,
                         std::span<const double> degree, double mean_radius, std::size_t slabs, int axis) {
    SlabProfile out;
    for (auto* column : {&out.solid_volume_fraction, &out.coordination_number, &out.mean_overlap_ratio,
                         &out.contacts_through})
        column->assign(slabs, 0);
    const double width = box.length / static_cast<double>(slabs);
    std::vector<double> centres(slabs, 0), points(slabs, 0);
    const auto slab_of = [&](double x) { return static_cast<std::int64_t>(std::floor(x / width)); };
    for (std::size_t i = 0; i < box.size(); ++i) {
        const double x = box.position[i][axis], r = box.radius[i];
        double below = 0;
        for (std::int64_t s = slab_of(x - r); s <= slab_of(x + r); ++s) {
            const double up_to = sphere_below(r, static_cast<double>(s + 1) * width - x);
            out.solid_volume_fraction[wrapped(s, slabs)] += up_to - below;
            below = up_to;
        }
        const std::size_t home = wrapped(slab_of(x), slabs);
        out.coordination_number[home] += degree[i];
        ++centres[home];
    }
    for (const ContactVector& c : contacts) {
        const double from = box.position[c.i][axis], reach = c.distance * c.normal[axis];
        const double point = from + (box.radius[c.i] - 0.5 * c.overlap) * c.normal[axis];
        const std::size_t home = wrapped(slab_of(point), slabs);
        out.mean_overlap_ratio[home] += c.overlap / mean_radius;
        ++points[home];
        const auto [low, high] = std::minmax({slab_of(from), slab_of(from + reach)});
        for (std::int64_t plane = low + 1; plane <= high; ++plane)
            ++out.contacts_through[wrapped(plane, slabs)];
    }
    for (std::size_t s = 0; s < slabs; ++s) {
        out.solid_volume_fraction[s] /= width * box.length * box.length;
        out.coordination_number[s] /= std::max(1.0, centres[s]);
        out.mean_overlap_ratio[s] /= std::max(1.0, points[s]);
    }
    return out;
}

/// Windows of `window` slabs at the face and inside: the face's window is centred on it.
struct Windows {
    double face = 0;
    std::vector<double> inside;
};
Windows windows_of(const std::vector<double>& value, std::size_t window) {
    if (window == 1) // planes
        return {value.front(), {value.begin() + 1, value.end()}};
    Windows out{0.5 * (value.front() + value.back()), {}};
    for (std::size_t s = 1; s + 2 < value.size(); ++s)
        out.inside.push_back(0.5 * (value[s] + value[s + 1]));
    return out;
}

/// Each slab against the others of its axis but its two neighbours, which the same seam may reach; the spread
/// is that of all three axes without the three.
SeamScore::Outlier find_outlier(const std::array<SlabProfile, 3>& profile,
                                std::vector<double> SlabProfile::*column, std::size_t axis, double width,
                                double first_middle) {
    const std::vector<double>& value = profile[axis].*column;
    const std::size_t n = value.size();
    const auto squares_about_mean = [](std::span<const double> values) {
        const double m = mean(values);
        double sum = 0;
        for (double v : values)
            sum += (v - m) * (v - m);
        return sum;
    };
    double elsewhere = 0;
    for (std::size_t a = 0; a < 3; ++a)
        elsewhere += a == axis ? 0 : squares_about_mean(profile[a].*column);
    const double others = static_cast<double>(n - 3), freedom = others - 1 + 2 * static_cast<double>(n - 1);
    SeamScore::Outlier out;
    std::vector<double> rest(n - 3);
    for (std::size_t s = 0; s < n; ++s) {
        for (std::size_t k = 0; k < rest.size(); ++k)
            rest[k] = value[(s + 2 + k) % n];
        const double difference = value[s] - mean(rest), rounding = 1e-12 * std::abs(mean(rest));
        if (std::abs(difference) <= rounding)
            continue;
        const double error = std::sqrt((squares_about_mean(rest) + elsewhere) / freedom * (1 + 1 / others));
        const double z = difference / std::max(error, rounding);
        if (std::abs(z) > std::abs(out.z_score))
            out = {static_cast<double>(s) * width + first_middle, value[s], z, false};
    }
    out.conspicuous = std::abs(out.z_score) >
                      student_t_quantile(1 - SeamCheck::probability / (2 * static_cast<double>(n)), freedom);
    return out;
}

std::array<SeamScore, 3> scores(const std::array<SlabProfile, 3>& profile,
                                std::vector<double> SlabProfile::*column, std::size_t window, double width) {
    std::array<SeamScore, 3> out;
    double variance = 0, largest = 0;
    double independent = 0; // windows that do not overlap, of one axis
    for (std::size_t a = 0; a < 3; ++a) {
        const Windows w = windows_of(profile[a].*column, window);
        out[a].face = w.face;
        out[a].inside = mean(w.inside);
        double squares = 0;
        for (double v : w.inside)
            squares += (v - out[a].inside) * (v - out[a].inside);
        variance += squares / static_cast<double>(w.inside.size()) / 3;
        largest = std::max({largest, std::abs(w.face), std::abs(out[a].inside)});
        independent = static_cast<double>(profile[a].solid_volume_fraction.size() - window) /
                      static_cast<double>(window);
    }
    variance *= independent / (independent - 1);
    const double error = std::sqrt(variance * (1 + 1 / independent));
    const double threshold = student_t_quantile(1 - SeamCheck::probability / 2, 3 * (independent - 1));
    for (std::size_t a = 0; a < 3; ++a) {
        SeamScore& s = out[a];
        s.standard_error = error;
        const double difference = s.face - s.inside;
        // what is below rounding is no difference, and no spread either
        if (std::abs(difference) > 1e-12 * largest)
            s.z_score = difference / std::max(error, 1e-12 * largest);
        s.conspicuous = std::abs(s.z_score) > threshold;
        s.outlier = find_outlier(profile, column, a, width, window == 1 ? 0 : width / 2);
    }
    return out;
}

} // namespace

double sphere_below(double radius, double height) {
    if (height <= -radius)
        return 0;
    if (height >= radius)
        return 4.0 / 3 * std::numbers::pi * radius * radius * radius;
    const double cap = radius + height; // depth of the part below the plane
    return std::numbers::pi * cap * cap * (3 * radius - cap) / 3;
}

SeamCheck seam_check(const PgBox& box, std::span<const ContactVector> contacts) {
    SeamCheck out;
    if (box.size() == 0)
        return out;
    const double mean_radius = mean(box.radius);
    const std::size_t slabs =
        std::max<std::size_t>(8, static_cast<std::size_t>(box.length / (2 * mean_radius) + 1e-9));
    out.slab_width = box.length / static_cast<double>(slabs);
    std::vector<double> degree(box.size(), 0);
    for (const ContactVector& c : contacts) {
        ++degree[c.i];
        ++degree[c.j];
    }
    for (int a = 0; a < 3; ++a)
        out.profile[static_cast<std::size_t>(a)] = slab_profile(box, contacts, degree, mean_radius, slabs, a);
    const auto fraction = scores(out.profile, &SlabProfile::solid_volume_fraction, 2, out.slab_width);
    const auto coordination = scores(out.profile, &SlabProfile::coordination_number, 2, out.slab_width);
    const auto overlap = scores(out.profile, &SlabProfile::mean_overlap_ratio, 2, out.slab_width);
    const auto through = scores(out.profile, &SlabProfile::contacts_through, 1, out.slab_width);
    for (std::size_t a = 0; a < 3; ++a) {
        out.axis[a] = {fraction[a], coordination[a], overlap[a], through[a]};
        for (const SeamScore* s : {&fraction[a], &coordination[a], &overlap[a], &through[a]})
            out.uniform = out.uniform && !s->conspicuous && !s->outlier.conspicuous;
        out.contacts_across[a] = static_cast<std::size_t>(out.profile[a].contacts_through.front());
    }
    return out;
}

} // namespace talus::measure
