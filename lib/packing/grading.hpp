// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace talus::packing {

/// A grading (particle size distribution) as a soil laboratory gives it: the part by mass of all grains that
/// is finer than a diameter. Between its points it is linear in the logarithm of the diameter, a straight
/// line on the laboratory's semi-logarithmic paper.
struct GradingCurve {
    std::vector<double> diameter;       ///< m, rising
    std::vector<double> fraction_finer; ///< from 0 at the first diameter to 1 at the last, never falling

    bool empty() const { return diameter.empty(); }
};

/// Reads a curve from comma-separated text with the columns `diameter` and either `fraction_finer` (0 to 1)
/// or `percent_finer` (0 to 100); other columns, empty lines and lines that begin with '#' are passed over.
/// @param name   of the file, for messages
/// @param length what reads a diameter ("0.2mm"), in m; may throw Error
/// @throws Error(input_invalid) as "name:line: what was found and the cure"
GradingCurve parse_grading(std::string_view text, const std::string& name,
                           const std::function<double(std::string_view)>& length);

/// Part of the mass finer than a diameter.
double fraction_finer(const GradingCurve& curve, double diameter);

/// The curve as a distribution of numbers of grains: as mass goes with d^3, the number of grains of a stretch
/// of the curve goes with its mass over d^3, integrated along it.
class GrainNumbers {
public:
    explicit GrainNumbers(const GradingCurve& curve);
    /// Mean of d^3 over all grains, m^3.
    double mean_cube() const { return 1 / total_; }
    /// The diameter below which this part of the number of grains lies; in [0, 1].
    double quantile(double part) const;

private:
    const GradingCurve& curve_;
    double total_ = 0;          ///< grains per mass in units of pi/6 density
    std::vector<double> up_to_; ///< grains finer than each point of the curve, same units
};

/// Diameters of `count` grains, rising: the grains in order of size are parted into equal numbers, and each
/// has the mass that the curve gives its part. So masses add up, and the curve made is nowhere further from
/// the one asked for than the mass of one grain.
std::vector<double> diameters_of(const GradingCurve& curve, std::size_t count);

/// The curve that grains of these radii make, at `points` diameters evenly spaced in their logarithm (one
/// where all grains are equal) and at those of `also` that lie between: the mass of grains not larger than
/// each.
GradingCurve realised_grading(std::span<const double> radius, std::span<const double> also = {},
                              std::size_t points = 64);

/// Largest difference between the part finer that grains of these radii have and what the curve asks for,
/// over all diameters (Kolmogorov distance of the masses).
double distance(const GradingCurve& curve, std::span<const double> radius);

/// The same curve with all diameters multiplied.
GradingCurve scaled(GradingCurve curve, double factor);

} // namespace talus::packing
