// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/variants.hpp"

#include "base/error.hpp"
#include "base/random.hpp"
#include "contact/constants.hpp"
#include "engine/simulation.hpp"
#include "packing/assemble.hpp"
#include "packing/histories.hpp"
#include "packing/minimise.hpp"
#include "particles/seams.hpp"
#include "search/cell_grid.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <map>
#include <numbers>

namespace talus::packing {

namespace {

double largest_radius(const PgBox& box) {
    return box.radius.empty() ? 0 : *std::max_element(box.radius.begin(), box.radius.end());
}

/// Contact branch from i to j, m.
Vec3 branch(const PgBox& box, std::size_t contact) {
    const auto& image = box.contacts.image[contact];
    const auto [i, j] = box.contacts.pair[contact];
    return box.position[static_cast<std::size_t>(j)] +
           Vec3{double(image[0]), double(image[1]), double(image[2])} * box.length -
           box.position[static_cast<std::size_t>(i)];
}

void check(const PgBox& first, const VariantSettings& s) {
    const double least = 2 * largest_radius(first);
    if (!(s.skin_thickness >= least && 2 * s.skin_thickness + 2 * least <= first.length))
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("skin_thickness: found {:.6g} m, expected at least two largest radii ({:.6g} m), "
                        "which contacts across a face take up, and at most {:.6g} m, which leaves an "
                        "interior of four: use smaller grains or a larger box",
                        s.skin_thickness, least, 0.5 * first.length - least));
    if (s.attempts.value_or(1) < 1 || s.iterations < 1)
        throw Error(ExitCode::configuration_invalid, "variants: expected at least one attempt and iteration");
}

/// Next to the skin grains start from where they were, and only deeper ones are thrown in anew: random
/// packings against a wall that does not give way are some 1 % less dense, and at the box's fraction under
/// many times the pressure. Thickness of that layer in largest radii.
constexpr double layer_radii = 2, layer_part = 0.1; ///< the second: of the interior's edge at most
/// An interior of whose grains more than this part stands where grains of the first box's do is none of its
/// own.
constexpr double most_kept = 0.75;
/// Shaking: all interior grains are displaced at random by up to this many mean radii, less from one to the
/// next, and relaxed after each, this far above the box's solid fraction.
constexpr double shake_first = 0.5, shake_last = 0.1;
constexpr int shakes = 20;
constexpr double shake_excess = 0.03;
/// An interior whose pressure is within this factor (its logarithm) of the first box's is taken at once.
constexpr double good_pressure = 0.5;
/// With friction: by how much the solid fraction lies below the box's own where grains begin to grow, the
/// first attempt's and bounds for the others.
constexpr double growth_start = -0.05, growth_loosest = -0.12, growth_densest = -0.02;

/// Fewer grains scatter more from attempt to attempt, and cost little.
constexpr std::size_t few_grains = 1000;

/// Overcompression of the first attempt, as in compress().
double first_excess(const PgBox& box) {
    const auto [least, most] = std::minmax_element(box.radius.begin(), box.radius.end());
    return *least < *most ? 0.004 : 0.013;
}

/// Asks of the points in the 27 cells about p, none of them through a face, until one answers true; whether
/// one did.
template <class Ask>
bool for_members_around(const search::CellGrid& grid, const Vec3& p, Ask&& ask) {
    const auto home = grid.coordinates(p);
    const auto cells = grid.cells();
    for (int z = std::max(0, home[2] - 1); z <= std::min(cells[2] - 1, home[2] + 1); ++z)
        for (int y = std::max(0, home[1] - 1); y <= std::min(cells[1] - 1, home[1] + 1); ++y)
            for (int x = std::max(0, home[0] - 1); x <= std::min(cells[0] - 1, home[0] + 1); ++x)
                for (const std::uint32_t k : grid.members(grid.index({x, y, z})))
                    if (ask(k))
                        return true;
    return false;
}

/// One variant being made, in reduced units (box edge 1): rows are the interior's grains, then the skin's.
class Variant {
public:
    Variant(const PgBox& first, const VariantSettings& settings, ThreadTeam& team,
            const VariantObserver& observer)
        : first_(first), s_(settings), team_(team), observer_(observer),
          skin_(skin_rows(first, settings.skin_thickness)) {
        for (std::size_t row = 0; row < first.size(); ++row)
            (skin_[row] ? skin_at_ : interior_at_).push_back(static_cast<std::uint32_t>(row));
        if (interior_at_.empty())
            throw Error(ExitCode::configuration_invalid,
                        fmt::format("skin_thickness: {:.6g} m leaves no grain in the interior: use smaller "
                                    "grains or a larger box",
                                    settings.skin_thickness));
        attempts_ =
            s_.attempts.value_or(interior_at_.size() < few_grains && s_.material.friction == 0 ? 20 : 8);
        for (const double r : first.radius)
            fraction_ += 4.0 / 3.0 * std::numbers::pi * std::pow(r / first.length, 3);
    }
    VariantResult run();

private:
    struct Attempt {
        PgBox box;
        InteriorMeasures interior;
        std::string failure; ///< empty: in balance, and fits the first box
    };
    Attempt attempt(double excess, bool from_random, double begin, double end);
    void shake(double begin, double end);
    double grow_with_friction(double excess, double begin, double end);
    void give_displacements(PgBox& box, const std::vector<std::uint32_t>& row_of) const;
    /// Random numbers of this variant: streams from here on, restarts first.
    std::uint64_t stream() const { return (std::uint64_t{0x766172} << 40) + (s_.number << 16); }
    void restart(std::uint64_t restart);
    Minimum relax_at(double excess, double unbalanced_force, double begin, double end);
    InteriorMeasures state_of(const ContactSums& sums) const;
    PgBox assemble() const;
    double kept_fraction(const PgBox& box) const;

    const PgBox& first_;
    const VariantSettings& s_;
    ThreadTeam& team_;
    const VariantObserver& observer_;
    std::vector<std::uint8_t> skin_;                   ///< of the first box's rows
    std::vector<std::uint32_t> interior_at_, skin_at_; ///< rows of the first box
    std::vector<double> radius_;                       ///< [interior], m, in the order of the spheres
    std::optional<SoftSpheres> spheres_;
    double fraction_ = 0;       ///< of the box
    double compressed_ = 0;     ///< fraction at the present radii less `fraction_`
    ContactTable displacement_; ///< with friction: of spheres that touch
    std::uint64_t shaken_ = 0;
    std::int64_t attempts_ = 0; ///< at most
    std::int64_t iterations_ = 0;
};

/// New places for the interior's grains, uniform where interior centres were; none within half a contact of
/// a skin's grain, whose other side it might be pushed to. Philox stream of variant and restart.
void Variant::restart(std::uint64_t restart) {
    const std::size_t n = interior_at_.size();
    const double length = first_.length, skin = s_.skin_thickness / length;
    constexpr double nearest = 0.7;
    const double core =
        skin + std::min(layer_radii * largest_radius(first_) / length, layer_part * (1 - 2 * skin));
    std::vector<Vec3> skin_position;
    for (const std::uint32_t row : skin_at_)
        skin_position.push_back(first_.position[row] / length);
    const double reach = 2 * nearest * largest_radius(first_) / length;
    search::CellGrid grid({0, 0, 0}, {1, 1, 1}, reach, skin_position.size());
    grid.sort(skin_position.size(), [&](std::size_t k) { return skin_position[k]; });
    const auto free = [&](const Vec3& p, double r) {
        return !for_members_around(grid, p, [&](std::uint32_t k) {
            const double least = nearest * (r + first_.radius[skin_at_[k]] / length);
            return norm2(skin_position[k] - p) < least * least;
        });
    };
    Philox random(s_.seed, stream() + restart);
    std::vector<Vec3> drawn(n);
    for (std::size_t k = 0; k < n; ++k) {
        const double r = first_.radius[interior_at_[k]] / length;
        if (depth_below_faces(first_.position[interior_at_[k]], length) / length < core) {
            drawn[k] = first_.position[interior_at_[k]] / length;
            continue;
        }
        do {
            for (int axis = 0; axis < 3; ++axis)
                drawn[k][axis] = core + (1 - 2 * core) * random.uniform();
        } while (!free(drawn[k], r));
    }
    double mean = 0;
    for (const std::uint32_t row : interior_at_)
        mean += first_.radius[row] / length / static_cast<double>(n);
    const auto order = morton_order(drawn, 2 * mean);
    std::vector<Vec3> position;
    std::vector<double> radius;
    radius_.clear();
    for (const std::uint32_t k : order) {
        position.push_back(drawn[k]);
        radius_.push_back(first_.radius[interior_at_[k]]);
        radius.push_back(radius_.back() / length);
    }
    position.insert(position.end(), skin_position.begin(), skin_position.end());
    for (const std::uint32_t row : skin_at_)
        radius.push_back(first_.radius[row] / length);
    spheres_.emplace(position, radius, team_, n);
    compressed_ = 0;
}

InteriorMeasures Variant::state_of(const ContactSums& sums) const {
    InteriorMeasures state;
    state.particles = interior_at_.size();
    state.coordination_number =
        2 * static_cast<double>(sums.contacts) / static_cast<double>(interior_at_.size());
    const double modulus = contact::effective_youngs_modulus(s_.material, s_.material),
                 volume = 1 - skin_volume_fraction(1, s_.skin_thickness / first_.length);
    state.pressure = sums.virial / 3 / volume * modulus;
    state.unbalanced_force = sums.unbalanced_force();
    return state;
}

/// All radii for a solid fraction by `excess` above the box's own, then relaxation of the interior.
Minimum Variant::relax_at(double excess, double unbalanced_force, double begin, double end) {
    spheres_->scale_radii(std::cbrt((fraction_ + excess) / (fraction_ + compressed_)));
    compressed_ = excess;
    MinimiseLimits limits;
    limits.unbalanced_force = unbalanced_force;
    limits.iterations = std::max<std::int64_t>(0, s_.iterations - iterations_);
    const auto note = [&](std::int64_t, const ContactSums& sums) {
        const InteriorMeasures state = state_of(sums);
        const double done =
            std::log(std::max(1.0, 1 / state.unbalanced_force)) / std::log(1 / unbalanced_force);
        if (observer_)
            observer_(state, begin + (end - begin) * std::clamp(done, 0.0, 1.0));
    };
    const Minimum minimum = minimise(*spheres_, limits, note);
    iterations_ += minimum.iterations;
    return minimum;
}

/// The box as it stands: the skin's grains in their rows, the interior's in the others, along a Morton curve.
PgBox Variant::assemble() const {
    const Box unit{{0, 0, 0}, {1, 1, 1}, {true, true, true}};
    std::vector<Vec3> inside(interior_at_.size());
    double mean = 0;
    for (std::size_t k = 0; k < inside.size(); ++k) {
        inside[k] = unit.wrap(spheres_->position(k));
        mean += radius_[k] / static_cast<double>(inside.size());
    }
    const auto order = morton_order(inside, 2 * mean / first_.length);
    PgBox out;
    out.length = first_.length;
    out.density = first_.density;
    out.position = first_.position;
    out.radius = first_.radius;
    for (std::size_t k = 0; k < inside.size(); ++k) {
        out.position[interior_at_[k]] = out.box().wrap(inside[order[k]] * out.length);
        out.radius[interior_at_[k]] = radius_[order[k]];
    }
    out.contacts = touching(out, team_);
    if (s_.material.friction > 0) {
        std::vector<std::uint32_t> row_of(first_.size());
        for (std::size_t k = 0; k < inside.size(); ++k)
            row_of[order[k]] = interior_at_[k];
        std::copy(skin_at_.begin(), skin_at_.end(),
                  row_of.begin() + static_cast<std::ptrdiff_t>(inside.size()));
        give_displacements(out, row_of);
    }
    return out;
}

/// Radii grow from a solid fraction `excess` below the box's own, where grains without friction found places
/// free of overlap, in small steps with friction on: they jam as a sediment with friction does that is
/// compressed. Returns the interior's mean net force over the mean contact force.
double Variant::grow_with_friction(double excess, double begin, double end) {
    const std::size_t n = interior_at_.size(), all = first_.size();
    const double length = first_.length, start = std::cbrt((fraction_ + excess) / fraction_);
    constexpr double stage_strain = 1e-3;
    constexpr std::int64_t stage_steps = 150;
    const auto stages = static_cast<std::int64_t>(std::ceil((1 - start) / stage_strain));

    engine::Scene scene;
    scene.gravity = {};
    scene.material = s_.material;
    scene.box = first_.box();
    Grains grains;
    grains.species.assign(all, Species::fixed);
    std::fill_n(grains.species.begin(), n, Species::grain);
    grains.mass.resize(all);
    grains.radius.resize(all);
    grains.position.resize(all);
    for (std::size_t k = 0; k < all; ++k) {
        const double r = k < n ? radius_[k] : first_.radius[skin_at_[k - n]];
        grains.mass[k] = 4.0 / 3.0 * std::numbers::pi * r * r * r * s_.material.density;
        grains.position[k] =
            scene.box->wrap(k < n ? spheres_->position(k) * length : first_.position[skin_at_[k - n]]);
    }
    // Of the order of the box's own waves, so that they die within few periods.
    const double damping = 0.2 * std::sqrt(s_.material.youngs_modulus / s_.material.density) / length;
    double unbalanced = 1;
    displacement_ = {};
    for (std::int64_t stage = 1; stage <= stages; ++stage) {
        const double factor = start + (1 - start) * static_cast<double>(stage) / static_cast<double>(stages);
        for (std::size_t k = 0; k < all; ++k)
            grains.radius[k] =
                (k < n ? radius_[k] : first_.radius[skin_at_[k - n]]) * (stage == stages ? 1 : factor);
        engine::Simulation simulation(scene, grains, team_);
        if (stage > 1)
            simulation.adopt_histories(displacement_);
        simulation.set_viscous_damping(damping);
        const std::int64_t most = stage < stages ? stage_steps : s_.iterations / attempts_;
        for (std::int64_t step = 0; step < most; ++step) {
            simulation.step();
            ++iterations_;
            if (stage == stages && (step + 1) % stage_steps == 0) {
                const engine::RestState rest = simulation.rest_state();
                unbalanced = rest.unbalanced_force;
                if (observer_) {
                    InteriorMeasures state;
                    state.particles = n;
                    state.coordination_number = rest.coordination_number;
                    state.unbalanced_force = unbalanced;
                    observer_(state,
                              begin + (end - begin) *
                                          (0.5 + 0.5 * std::clamp(std::log(std::max(1.0, 1 / unbalanced)) /
                                                                      std::log(1 / s_.unbalanced_force),
                                                                  0.0, 1.0)));
                }
                // The second asks that what is in balance does not just pass through it.
                if (unbalanced < s_.unbalanced_force &&
                    simulation.energies().kinetic < 1e-6 * simulation.energies().elastic)
                    break;
            }
        }
        engine::SavedState saved = simulation.save();
        grains.position = std::move(saved.position);
        grains.velocity = std::move(saved.half_velocity);
        grains.angular_velocity = std::move(saved.half_angular_velocity);
        displacement_ = contacts_of(saved);
    }
    std::vector<Vec3> reduced(all);
    for (std::size_t k = 0; k < all; ++k)
        reduced[k] = grains.position[k] / length;
    spheres_->set_positions(reduced);
    return unbalanced;
}

/// Part of the interior's grains that lie within half a mean radius of one of the first box's.
double Variant::kept_fraction(const PgBox& box) const {
    double within = 0;
    for (const double r : radius_)
        within += 0.5 * r / static_cast<double>(radius_.size());
    const Vec3 upper{box.length, box.length, box.length};
    search::CellGrid grid({}, upper, within, interior_at_.size());
    grid.sort(interior_at_.size(), [&](std::size_t k) { return first_.position[interior_at_[k]]; });
    std::size_t kept = 0;
    for (const std::uint32_t row : interior_at_) {
        const Vec3& p = box.position[row];
        for_members_around(grid, p, [&](std::uint32_t k) {
            if (norm2(first_.position[interior_at_[k]] - p) >= within * within)
                return false;
            ++kept;
            return true;
        });
    }
    return static_cast<double>(kept) / static_cast<double>(interior_at_.size());
}

/// Tangential displacements of the box just assembled: of the skin's contacts as in the first box, of the
/// others as they came about. `row_of[k]` is the box's row of sphere k.
void Variant::give_displacements(PgBox& box, const std::vector<std::uint32_t>& row_of) const {
    using Pair = std::array<std::int64_t, 2>;
    std::map<Pair, Vec3> known;
    const auto note = [&known](std::int64_t i, std::int64_t j, const Vec3& u) {
        known[{std::min(i, j), std::max(i, j)}] = i < j ? u : -1 * u;
    };
    for (std::size_t c = 0; c < displacement_.size(); ++c)
        note(row_of[static_cast<std::size_t>(displacement_.pair[c][0])],
             row_of[static_cast<std::size_t>(displacement_.pair[c][1])],
             displacement_.tangential_displacement[c]);
    for (std::size_t c = 0; c < first_.contacts.tangential_displacement.size(); ++c)
        if (const auto [i, j] = first_.contacts.pair[c];
            skin_[static_cast<std::size_t>(i)] && skin_[static_cast<std::size_t>(j)])
            note(i, j, first_.contacts.tangential_displacement[c]);
    for (const Pair& pair : box.contacts.pair) {
        const auto at = known.find(pair);
        box.contacts.tangential_displacement.push_back(at == known.end() ? Vec3{} : at->second);
    }
}

/// One attempt, from new places or from where the last one ended.
Variant::Attempt Variant::attempt(double excess, bool from_random, double begin, double end) {
    Attempt out;
    const auto at = [&](double part) { return begin + part * (end - begin); };
    double unbalanced = 0;
    if (s_.material.friction > 0) {
        relax_at(excess, 1e-2, begin, at(0.2));
        unbalanced = grow_with_friction(excess, at(0.2), end);
        if (unbalanced >= s_.unbalanced_force)
            out.failure =
                fmt::format("unbalanced_force of the interior is {:.3g}, above {:g}: use another seed",
                            unbalanced, s_.unbalanced_force);
    } else {
        if (!from_random)
            shake(begin, at(0.3));
        relax_at(excess, 1e-2, at(0.3), at(0.4));
        const Minimum minimum = relax_at(0, s_.unbalanced_force, at(0.4), end);
        if (!minimum.converged)
            out.failure =
                fmt::format("unbalanced_force of the interior is {:.3g}, above {:g}: allow more iterations",
                            minimum.sums.unbalanced_force(), s_.unbalanced_force);
        else if (!minimum.jammed)
            out.failure = "pressure of the interior is 0: use another seed";
    }
    out.box = assemble();
    if (const auto difference = seam_difference(first_, out.box))
        out.failure = fmt::format("an interior grain came to a face ({}): use a thicker skin", *difference);
    out.interior = measure_interior(out.box, skin_, s_.skin_thickness, s_.material);
    out.interior.kept_fraction = kept_fraction(out.box);
    if (out.failure.empty() && out.interior.kept_fraction > most_kept)
        out.failure =
            fmt::format("{:.0f} % of the interior's grains came back to places of the first box's: use a "
                        "thinner skin, smaller grains or a larger box",
                        100 * out.interior.kept_fraction);
    if (s_.material.friction > 0)
        out.interior.unbalanced_force = unbalanced;
    return out;
}

/// Random displacements, relaxed roughly after each: grains find places that fit better.
void Variant::shake(double begin, double end) {
    Philox random(s_.seed, stream() + 0x8000 + shaken_++);
    for (int k = 0; k < shakes; ++k) {
        const double most = 0.5 * spheres_->mean_diameter() * shake_first *
                            std::pow(shake_last / shake_first, double(k) / (shakes - 1));
        std::vector<Vec3> position = spheres_->positions();
        for (std::size_t i = 0; i < spheres_->mobile(); ++i)
            for (int axis = 0; axis < 3; ++axis)
                position[i][axis] += most * (2 * random.uniform() - 1);
        spheres_->set_positions(position);
        relax_at(shake_excess, 3e-2, begin + (end - begin) * k / shakes,
                 begin + (end - begin) * (k + 1) / shakes);
    }
}

VariantResult Variant::run() {
    VariantResult result;
    result.first = measure_interior(first_, skin_, s_.skin_thickness, s_.material);
    const double aim = result.first.coordination_number;
    const double tolerance = s_.coordination_tolerance.value_or(
        std::max(0.1, 3.6 / std::sqrt(static_cast<double>(interior_at_.size()))));
    const bool friction = s_.material.friction > 0;
    double excess = friction ? growth_start : first_excess(first_);
    double loosest = growth_loosest, densest = growth_densest;
    double best = std::numeric_limits<double>::infinity();
    std::uint64_t restarts = 0;
    bool from_random = true, in_reach = false;
    for (result.attempts = 1;; ++result.attempts) {
        if (from_random)
            restart(restarts++);
        const double part = 1.0 / static_cast<double>(attempts_);
        const double begin = static_cast<double>(result.attempts - 1) * part;
        Attempt made = attempt(excess, from_random, begin, begin + part);
        const double off = made.interior.coordination_number - aim;
        if (made.failure.empty()) {
            // Beyond the tolerance the coordination number decides, within it the pressure.
            const double score = std::abs(off) > tolerance
                                     ? 1000 * std::abs(off)
                                     : std::abs(std::log(made.interior.pressure / result.first.pressure));
            if (score < best) {
                best = score;
                in_reach = std::abs(off) <= tolerance;
                result.box = std::move(made.box);
                result.interior = made.interior;
                result.overcompression = excess;
            }
        } else if (!std::isfinite(best)) {
            result.failure = made.failure;
        }
        if (best < good_pressure || result.attempts >= attempts_ || iterations_ >= s_.iterations)
            break;
        if (friction && made.failure.empty()) {
            // Grown from further below there are fewer contacts and more pressure.
            const bool looser =
                off > tolerance || (off > -tolerance && made.interior.pressure < result.first.pressure);
            (looser ? densest : loosest) = excess;
            excess = 0.5 * (loosest + densest);
        }
        // With too many contacts, or as many and too much pressure: shaken and pressed once more. Else anew.
        from_random = friction || !(made.failure.empty() && off > -tolerance);
    }
    result.iterations = iterations_;
    if (std::isfinite(best) && !in_reach)
        result.failure = fmt::format("coordination_number of the interior is {:.3f}, not within {:.3f} of "
                                     "{:.3f} after {} attempts: use a "
                                     "larger coordination_tolerance or another seed",
                                     result.interior.coordination_number, tolerance, aim, result.attempts);
    else if (in_reach)
        result.failure.clear();
    result.converged = in_reach;
    return result;
}

} // namespace

std::vector<std::uint8_t> skin_rows(const PgBox& box, double thickness) {
    std::vector<std::uint8_t> skin(box.size());
    for (std::size_t row = 0; row < box.size(); ++row)
        skin[row] = depth_below_faces(box.position[row], box.length) <= thickness;
    return skin;
}

double skin_volume_fraction(double length, double thickness) {
    const double inside = std::max(0.0, 1 - 2 * thickness / length);
    return 1 - inside * inside * inside;
}

std::string skin_hash(const PgBox& box, double thickness) {
    std::uint64_t h = 0x746c7573;
    const auto take = [&h](std::uint64_t word) { // the mixing step of SplitMix64
        h += 0x9E3779B97F4A7C15u + word;
        h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9u;
        h = (h ^ (h >> 27)) * 0x94D049BB133111EBu;
        h ^= h >> 31;
    };
    take(box.size());
    take(std::bit_cast<std::uint64_t>(box.length));
    const std::vector<std::uint8_t> skin = skin_rows(box, thickness);
    for (std::size_t row = 0; row < box.size(); ++row) {
        if (!skin[row])
            continue;
        take(row);
        for (const double number :
             {box.position[row].x, box.position[row].y, box.position[row].z, box.radius[row]})
            take(std::bit_cast<std::uint64_t>(number));
    }
    return fmt::format("{:016x}", h);
}

InteriorMeasures measure_interior(const PgBox& box, std::span<const std::uint8_t> skin, double thickness,
                                  const Material& material) {
    const double modulus = contact::effective_youngs_modulus(material, material);
    std::vector<Vec3> net(box.size());
    double ends = 0, force = 0, virial = 0;
    for (std::size_t c = 0; c < box.contacts.size(); ++c) {
        const auto i = static_cast<std::size_t>(box.contacts.pair[c][0]),
                   j = static_cast<std::size_t>(box.contacts.pair[c][1]);
        const Vec3 d = branch(box, c);
        const double distance = norm(d), overlap = box.contacts.normal_overlap[c];
        const double f =
            contact::hertz_stiffness(modulus, box.radius[i] * box.radius[j] / (box.radius[i] + box.radius[j]),
                                     overlap) *
            overlap;
        net[i] -= d * (f / distance);
        net[j] += d * (f / distance);
        const double weight = (skin[i] ? 0 : 1) + (skin[j] ? 0 : 1);
        ends += weight;
        force += weight * f;
        virial += 0.5 * weight * f * distance;
    }
    InteriorMeasures out;
    double sum[2] = {0, 0}, count[2] = {0, 0};
    std::vector<std::uint8_t> touched(box.size(), 0);
    for (const auto& pair : box.contacts.pair)
        for (const std::int64_t row : pair)
            touched[static_cast<std::size_t>(row)] = 1;
    for (std::size_t row = 0; row < box.size(); ++row) {
        out.particles += skin[row] ? 0 : 1;
        sum[skin[row]] += norm(net[row]);
        count[skin[row]] += touched[row];
    }
    if (ends > 0) {
        const double mean = force / ends;
        out.coordination_number = ends / static_cast<double>(out.particles);
        out.unbalanced_force = sum[0] / std::max(1.0, count[0]) / mean;
        out.skin_unbalanced_force = sum[1] / std::max(1.0, count[1]) / mean;
        out.pressure =
            virial / 3 / (std::pow(box.length, 3) * (1 - skin_volume_fraction(box.length, thickness)));
    }
    return out;
}

VariantResult make_variant(const PgBox& first, const VariantSettings& settings, ThreadTeam& team,
                           const VariantObserver& observer) {
    check(first, settings);
    return Variant(first, settings, team, observer).run();
}

} // namespace talus::packing
