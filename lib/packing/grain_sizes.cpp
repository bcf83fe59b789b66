// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/grain_sizes.hpp"

#include "base/error.hpp"
#include "packing/soft_spheres.hpp"

#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::packing {

namespace {

constexpr double densest = 0.7404805; ///< pi / sqrt(18), equal spheres
/// Small grains fill the gaps between large ones: no grading that anybody packs gets here.
constexpr double densest_graded = 0.9;
/// A whole number of grains may change the radii by no more than this part.
constexpr double largest_adjustment = 0.02;
constexpr std::int64_t fewest = 16;

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::configuration_invalid, what);
}

void check(const GrainSizes& s) {
    if (!(s.box_length > 0) || !std::isfinite(s.box_length))
        refuse(fmt::format("box_length: found {}, expected a length above 0", s.box_length));
    if (!(s.radius > 0) || !std::isfinite(s.radius))
        refuse(fmt::format("radius: found {}, expected a length above 0", s.radius));
    if (!(s.radius_min_ratio > 0 && s.radius_min_ratio <= 1))
        refuse(fmt::format("radius_min_ratio: found {}, expected above 0 and at most 1", s.radius_min_ratio));
    if (!(s.solid_volume_fraction > 0))
        refuse(fmt::format("solid_volume_fraction: found {}, expected above 0", s.solid_volume_fraction));
    if (!s.grading.empty() && s.solid_volume_fraction > densest_graded)
        refuse(fmt::format("solid_volume_fraction: found {}, expected at most {} for a grading",
                           s.solid_volume_fraction, densest_graded));
    if (s.grading.empty() && s.solid_volume_fraction > densest)
        refuse(fmt::format(
            "solid_volume_fraction: {} is more than the densest packing of equal spheres ({:.4f}): "
            "use about 0.64",
            s.solid_volume_fraction, densest));
    if (!(s.radius < SoftSpheres::largest_radius * s.box_length))
        refuse(fmt::format("radius: {} m {}is too large for a periodic box of {} m, grains would touch one "
                           "another through two "
                           "faces at once: use a radius below {:g} m{} or a larger box_length",
                           s.radius, s.grading.empty() ? "" : "(of the grading's largest grains) ",
                           s.box_length, SoftSpheres::largest_radius * s.box_length,
                           s.grading.empty() ? "" : ", which scales the grading,"));
}

/// <r^3> of the grading, or of the uniform distribution between ratio * radius and radius.
double mean_cube(const GrainSizes& s) {
    if (!s.grading.empty()) {
        const GradingCurve curve = asked_grading(s);
        return GrainNumbers(curve).mean_cube() / 8;
    }
    const double a = s.radius_min_ratio;
    return s.radius * s.radius * s.radius * (1 + a) * (1 + a * a) / 4;
}

} // namespace

bool all_equal(const GrainSizes& sizes) {
    return sizes.grading.empty() && sizes.radius_min_ratio == 1;
}

double smallest_radius(const GrainSizes& sizes) {
    return sizes.radius * (sizes.grading.empty()
                               ? sizes.radius_min_ratio
                               : sizes.grading.diameter.front() / sizes.grading.diameter.back());
}

GradingCurve asked_grading(const GrainSizes& sizes) {
    return sizes.grading.empty() ? GradingCurve{}
                                 : scaled(sizes.grading, 2 * sizes.radius / sizes.grading.diameter.back());
}

std::int64_t particle_count(const GrainSizes& sizes) {
    check(sizes);
    const double volume = sizes.box_length * sizes.box_length * sizes.box_length;
    const double exact =
        sizes.solid_volume_fraction * volume / (4.0 / 3.0 * std::numbers::pi * mean_cube(sizes));
    if (exact > 0x1p31)
        refuse(fmt::format(
            "{}: {} m in a box of {} m makes {:.3g} grains, more than 2^31: use a larger radius or a smaller "
            "box_length, boxes are tiled later{}",
            sizes.grading.empty() ? "radius" : "grading: largest radius", sizes.radius, sizes.box_length,
            exact, sizes.grading.empty() ? "" : "; or leave out the finest grains"));
    const std::int64_t count = sizes.particle_count.value_or(std::llround(exact));
    const double factor = std::cbrt(exact / static_cast<double>(count));
    if (sizes.particle_count && !(count > 0 && std::abs(factor - 1) <= largest_adjustment))
        refuse(
            fmt::format("particle_count: {} grains of this radius do not make a solid volume fraction of {}: "
                        "use about {:.0f} or another radius",
                        count, sizes.solid_volume_fraction, exact));
    if (count < fewest)
        refuse(fmt::format(
            "radius: {} m in a box of {} m makes only {} grains, fewer than {}: use a smaller radius "
            "or a larger box_length",
            sizes.radius, sizes.box_length, count, fewest));
    return count;
}

Radii draw_radii(const GrainSizes& sizes) {
    const auto n = static_cast<std::size_t>(particle_count(sizes));
    Radii out;
    if (sizes.grading.empty()) {
        const double smallest = smallest_radius(sizes);
        for (std::size_t i = 0; i < n; ++i) {
            const double part = (static_cast<double>(i) + 0.5) / static_cast<double>(n);
            out.radius.push_back(all_equal(sizes) ? sizes.radius
                                                  : smallest + (sizes.radius - smallest) * part);
        }
    } else
        for (const double diameter : diameters_of(asked_grading(sizes), n))
            out.radius.push_back(0.5 * diameter);
    double cubes = 0;
    for (const double r : out.radius)
        cubes += r * r * r;
    const double volume = sizes.box_length * sizes.box_length * sizes.box_length;
    out.factor = std::cbrt(sizes.solid_volume_fraction * volume / (4.0 / 3.0 * std::numbers::pi * cubes));
    for (double& r : out.radius)
        r *= out.factor;
    return out;
}

} // namespace talus::packing
