// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/triaxial.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::engine {

namespace {

/// Clamped particles weigh so much that nothing moves them but the platen.
constexpr double weight_of_clamped = 1e12;
/// Wave times in which the confining stress comes up by default.
constexpr double waves_of_consolidation = 20;
/// Times its ramp that consolidation usually takes.
constexpr double usual_consolidation = 1.2;
/// Part of the confining stress from which on the pressure follows what is felt.
constexpr double least_controlled = 0.2;
/// Wave times in which what was added to the pressure fades: a sheet that hangs free is not blown up for
/// ever.
constexpr double waves_remembered = 50;
/// Most that is added to the pressure or taken off: of the confining stress, and of the sheet's modulus.
constexpr double most_of_stress = 0.5, most_of_modulus = 0.05;
/// The membrane's modulus: a thousandth of the grains', as in the paper, but not less than so many times the
/// confining stress. A softer sheet is pushed in between the grains: at twice the stress it held with pores
/// of a grain's size (stress 200 kPa), at half it did not.
constexpr double part_of_youngs_modulus = 1e-3, least_of_stress = 2.5;
/// Of the grains' modulus, of the sheet where its edges lock. Single grains push against it with what a
/// column of grains carries, whatever the confining stress.
constexpr double locked_part_of_youngs_modulus = 0.2;
/// Least mean radii of a specimen's radius: below, a membrane of its grains' size is no surface.
constexpr double least_radii = 4;

double smooth_step(double x) {
    x = std::clamp(x, 0.0, 1.0);
    return x * x * (3 - 2 * x);
}

/// Pa, roughly, at its confining stress: E^2/3 stress^1/3, as Hertz contacts make it.
double specimen_stiffness(const Triaxial& t, const Material& material) {
    const double stress = std::max(t.confining_stress, 1e-5 * material.youngs_modulus);
    return 0.3 * std::pow(material.youngs_modulus, 2.0 / 3) * std::cbrt(stress);
}

/// s, that a wave takes through a specimen this high, and in which it is consolidated.
struct ConsolidationTimes {
    double wave = 0, ramp = 0;
};

ConsolidationTimes consolidation_times(const Triaxial& t, const Material& material, double height) {
    const double stiffness = specimen_stiffness(t, material),
                 wave = height * std::sqrt(material.density / stiffness);
    return {wave, t.consolidation_time.value_or(waves_of_consolidation * wave)};
}

/// A specimen's outline.
struct Outline {
    double x = 0, y = 0, radius = 0, bottom = 0, top = 0, mean_radius = 0; ///< m
};

Outline outline_of(const Grains& grains, double bedding) {
    Outline o;
    constexpr double inf = std::numeric_limits<double>::infinity();
    Vec3 lower{inf, inf, inf}, upper{-inf, -inf, -inf};
    for (std::size_t i = 0; i < grains.size(); ++i) {
        const double r = grains.radius[i];
        for (int k = 0; k < 3; ++k) {
            lower[k] = std::min(lower[k], grains.position[i][k] - r);
            upper[k] = std::max(upper[k], grains.position[i][k] + r);
        }
        o.mean_radius += r / static_cast<double>(grains.size());
    }
    o.x = 0.5 * (lower.x + upper.x);
    o.y = 0.5 * (lower.y + upper.y);
    o.bottom = lower.z + bedding * o.mean_radius;
    o.top = upper.z - bedding * o.mean_radius;
    for (std::size_t i = 0; i < grains.size(); ++i)
        o.radius = std::max(o.radius, std::hypot(grains.position[i].x - o.x, grains.position[i].y - o.y) +
                                          grains.radius[i]);
    return o;
}

double mass_of(double radius, double density) {
    return 4.0 / 3.0 * std::numbers::pi * radius * radius * radius * density;
}

void add_membrane(const Triaxial& t, const Material& material, Grains& grains) {
    const Outline o = outline_of(grains, t.bedding);
    const double r = t.membrane_radius.value_or(o.mean_radius), height = o.top - o.bottom;
    if (!(o.radius > least_radii * r) || !(height > least_radii * r))
        throw Error(
            ExitCode::input_invalid,
            fmt::format("the specimen is {:.3g} m high and {:.3g} m across: too small for a membrane of "
                        "particles of radius {:.3g} m; use finer grains or triaxial.membrane_radius",
                        height, 2 * o.radius, r));
    const auto around = static_cast<std::size_t>(std::lround(std::numbers::pi * o.radius / r));
    const auto rings = static_cast<std::size_t>(std::lround(height / (std::sqrt(3.0) * r))) + 1;
    const double step = 2 * std::numbers::pi / static_cast<double>(around),
                 rise = height / static_cast<double>(rings - 1);
    const auto angle_of = [&](std::size_t ring, std::size_t k) {
        return (static_cast<double>(k) + 0.5 * static_cast<double>(ring % 2)) * step;
    };
    std::vector<double> distance(rings * around, o.radius);
    for (std::size_t i = 0; i < grains.size(); ++i) {
        const double x = grains.position[i].x - o.x, y = grains.position[i].y - o.y, rho = std::hypot(x, y),
                     reach = grains.radius[i] + r;
        if (rho + reach <= o.radius)
            continue; // cannot hold a particle outside that radius
        const double z = grains.position[i].z - o.bottom, theta = std::atan2(y, x),
                     turn = std::asin(std::min(1.0, reach / rho));
        const auto first = static_cast<std::int64_t>(std::ceil((z - reach) / rise)),
                   last = static_cast<std::int64_t>(std::floor((z + reach) / rise));
        for (std::int64_t ring = std::max<std::int64_t>(first, 0);
             ring <= std::min<std::int64_t>(last, static_cast<std::int64_t>(rings) - 1); ++ring) {
            const auto from = static_cast<std::int64_t>(std::floor((theta - turn) / step)) - 1,
                       to = static_cast<std::int64_t>(std::ceil((theta + turn) / step)) + 1;
            for (std::int64_t k = from; k <= to; ++k) {
                const auto n = static_cast<std::int64_t>(around);
                const auto column = static_cast<std::size_t>(((k % n) + n) % n);
                const double angle = angle_of(static_cast<std::size_t>(ring), column);
                const double along = rho * std::cos(angle - theta), aside = rho * std::sin(angle - theta),
                             above = z - static_cast<double>(ring) * rise;
                const double room = reach * reach - aside * aside - above * above;
                if (along > 0 && room > 0) {
                    double& d = distance[static_cast<std::size_t>(ring) * around + column];
                    d = std::max(d, along + std::sqrt(room));
                }
            }
        }
    }
    if (grains.species.empty())
        grains.species.assign(grains.size(), Species::grain);
    for (std::size_t ring = 0; ring < rings; ++ring)
        for (std::size_t k = 0; k < around; ++k) {
            const double angle = angle_of(ring, k), d = distance[ring * around + k];
            const double z = ring + 1 == rings ? o.top : o.bottom + static_cast<double>(ring) * rise;
            grains.position.push_back({o.x + d * std::cos(angle), o.y + d * std::sin(angle), z});
            grains.radius.push_back(r);
            grains.species.push_back(Species::membrane);
            if (!grains.mass.empty())
                grains.mass.push_back(mass_of(r, material.density));
            if (!grains.material.empty())
                grains.material.push_back(0);
            for (auto* column : {&grains.velocity, &grains.angular_velocity})
                if (!column->empty())
                    column->push_back({});
            if (!grains.release.empty())
                grains.release.push_back(0);
        }
}

/// Gives the membrane's particles, from `first` on, their material and the clamped ones their weight.
void complete_membrane(const Material& material, std::uint8_t kind, std::size_t first, Grains& grains) {
    if (grains.material.empty() && kind > 0)
        grains.material.assign(grains.size(), 0);
    if (grains.mass.empty())
        for (const double radius : grains.radius)
            grains.mass.push_back(mass_of(radius, material.density));
    const double bottom = grains.position[first].z, top = grains.position.back().z;
    for (std::size_t i = first; i < grains.size(); ++i) {
        if (grains.species[i] != Species::membrane)
            continue; // a stray grain, which Membrane refuses
        if (kind > 0)
            grains.material[i] = kind;
        if (grains.position[i].z == bottom || grains.position[i].z == top)
            grains.mass[i] =
                std::max(grains.mass[i], weight_of_clamped * mass_of(grains.radius[i], material.density));
    }
}

} // namespace

void prepare_triaxial(Scene& scene, Grains& grains) {
    Triaxial& t = *scene.triaxial;
    const auto refuse = [](const char* what) {
        throw Error(ExitCode::configuration_invalid, fmt::format("triaxial: {}", what));
    };
    if (!scene.walls.empty())
        refuse("found walls beside it, expected none: the platens are the test's own");
    if (!scene.stages.empty())
        refuse("found stages or time.end beside it, expected neither: the test knows when it ends");
    const Box box = scene.box ? *scene.box : grains.box.value_or(Box{});
    if (box.periodic[0] || box.periodic[1] || box.periodic[2])
        refuse("found a periodic box, expected a specimen in open space: cut one with tile-trim --cylinder");
    if (scene.linear_law)
        refuse("found contact.law \"linear\", expected \"hertz-mindlin\"");
    for (const Species s : grains.species)
        if (s == Species::fixed)
            throw Error(ExitCode::input_invalid,
                        "triaxial: found fixed grains, expected a specimen without any");

    Material skin = scene.material;
    skin.friction = t.membrane_friction;
    std::uint8_t kind = 0;
    if (skin != scene.material) {
        scene.more_materials.push_back(skin);
        kind = static_cast<std::uint8_t>(scene.more_materials.size());
    }
    if (std::find(grains.species.begin(), grains.species.end(), Species::membrane) == grains.species.end())
        add_membrane(t, scene.material, grains);
    const std::size_t first = static_cast<std::size_t>(
        std::find(grains.species.begin(), grains.species.end(), Species::membrane) - grains.species.begin());
    complete_membrane(scene.material, kind, first, grains);
    const double bottom = grains.position[first].z, top = grains.position.back().z;
    Material platen = scene.material;
    platen.friction = t.platen_friction.value_or(scene.material.friction);
    scene.walls = {{.name = "platen_bottom",
                    .point = {0, 0, bottom},
                    .normal = {0, 0, 1},
                    .velocity = {},
                    .material = platen},
                   {.name = "platen_top",
                    .point = {0, 0, top},
                    .normal = {0, 0, -1},
                    .velocity = {},
                    .material = platen}};
    const ConsolidationTimes times = consolidation_times(t, scene.material, top - bottom);
    t.consolidation_time = times.ramp;
    if (t.confining_stress > 0) {
        Stage consolidate;
        consolidate.kind = Stage::Kind::consolidate;
        consolidate.name = "consolidate";
        consolidate.end = usual_consolidation * times.ramp;
        consolidate.limit = t.consolidation_limit * times.ramp;
        scene.stages.push_back(consolidate);
    }
    Stage shear;
    shear.kind = Stage::Kind::shear;
    shear.name = "shear";
    shear.end = 1.05 * (t.axial_strain + t.velocity_ramp) * (top - bottom) / t.platen_velocity;
    scene.stages.push_back(shear);
}

double membrane_modulus(const Triaxial& t, const Material& material) {
    return t.membrane_youngs_modulus.value_or(
        std::max(part_of_youngs_modulus * material.youngs_modulus, least_of_stress * t.confining_stress));
}

double locked_membrane_modulus(const Material& material) {
    return locked_part_of_youngs_modulus * material.youngs_modulus;
}

double TriaxialTest::Shape::outer() const {
    return std::sqrt(volume / (std::numbers::pi * height));
}

double TriaxialTest::Shape::area() const {
    return std::numbers::pi * inner() * inner();
}

TriaxialTest::TriaxialTest(const Triaxial& settings, const Material& material, double height)
    : settings_(settings), stiffness_(specimen_stiffness(settings, material)) {
    const ConsolidationTimes times = consolidation_times(settings, material, height);
    most_more_ =
        most_of_stress * settings.confining_stress + most_of_modulus * membrane_modulus(settings, material);
    consolidation_time_ = times.ramp;
    wave_time_ = times.wave;
}

void TriaxialTest::begin(Stage::Kind kind, std::int64_t step, const Shape& shape) {
    kind_ = kind;
    began_ = step;
    start_height_ = shape.height;
    start_volume_ = shape.area() * shape.height;
}

double TriaxialTest::axial_strain(const Shape& shape) const {
    return kind_ == Stage::Kind::shear ? 1 - shape.height / start_height_ : 0;
}

double TriaxialTest::volumetric_strain(const Shape& shape) const {
    return kind_ == Stage::Kind::shear ? 1 - shape.area() * shape.height / start_volume_ : 0;
}

bool TriaxialTest::done(double time_in_stage, const TriaxialMeasures& m, double unbalanced_force,
                        double allowed) const {
    if (kind_ == Stage::Kind::shear)
        return m.axial_strain >= settings_.axial_strain;
    const double wanted = settings_.confining_stress, off = settings_.consolidation_tolerance * wanted;
    return kind_ == Stage::Kind::consolidate && time_in_stage >= consolidation_time_ &&
           std::abs(m.axial_stress - wanted) < off && std::abs(m.confining_stress - wanted) < off &&
           unbalanced_force < allowed;
}

double TriaxialTest::target(std::int64_t step, double time_step) const {
    const double time = static_cast<double>(step - began_) * time_step;
    return settings_.confining_stress * (kind_ == Stage::Kind::shear ? 1.0
                                         : kind_ == Stage::Kind::consolidate
                                             ? smooth_step(time / consolidation_time_)
                                             : 0.0);
}

double TriaxialTest::pressure(std::int64_t step, double time_step, const Shape& shape) const {
    return (target(step, time_step) + more_) * shape.inner() / shape.outer();
}

double TriaxialTest::control(std::int64_t step, double time_step, const Shape& shape) {
    const double time = static_cast<double>(step - began_) * time_step, wanted = target(step, time_step),
                 part = std::min(1.0, 20 * time_step / wave_time_);
    carried_ += part * (force_ / shape.area() - carried_);
    felt_ += part * (stress_ * shape.outer() / shape.inner() - felt_);
    if (wanted >= least_controlled * settings_.confining_stress)
        more_ = std::clamp(more_ + time_step / wave_time_ * (wanted - felt_ - more_ / waves_remembered),
                           -most_more_, most_more_);
    if (kind_ == Stage::Kind::shear) {
        const double rise = 2 * settings_.velocity_ramp * start_height_ / settings_.platen_velocity;
        velocity_ = -settings_.platen_velocity * (rise > 0 ? smooth_step(time / rise) : 1.0);
    } else if (kind_ == Stage::Kind::consolidate) {
        const double lacks = wanted - carried_, fastest = 0.1 * shape.height / consolidation_time_;
        velocity_ = -std::clamp(shape.height * lacks / (stiffness_ * wave_time_), -fastest, fastest);
    } else {
        velocity_ = 0;
    }
    return velocity_;
}

std::vector<double> TriaxialTest::state() const {
    return {static_cast<double>(kind_),
            static_cast<double>(began_),
            velocity_,
            start_height_,
            start_volume_,
            carried_,
            felt_,
            more_,
            force_,
            stress_};
}

void TriaxialTest::set_state(std::span<const double> s) {
    kind_ = static_cast<Stage::Kind>(static_cast<int>(s[0]));
    began_ = static_cast<std::int64_t>(s[1]);
    velocity_ = s[2];
    start_height_ = s[3];
    start_volume_ = s[4];
    carried_ = s[5];
    felt_ = s[6];
    more_ = s[7];
    force_ = s[8];
    stress_ = s[9];
}

} // namespace talus::engine
