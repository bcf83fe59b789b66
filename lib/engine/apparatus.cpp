// SPDX-License-Identifier: GPL-3.0-or-later
/// The triaxial apparatus at work on the simulation's particles.
#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::engine {

void Simulation::make_apparatus(const Grains& grains) {
    if (!world_.alone())
        throw Error(ExitCode::configuration_invalid,
                    "triaxial: found several MPI ranks, expected one: use threads, and one task a test");
    const Triaxial& t = *scene_.triaxial;
    const double modulus = membrane_modulus(t, scene_.material);
    membrane_ = Membrane(grains, modulus, locked_membrane_modulus(scene_.material), t.membrane_damping);
    if (time_step_.step > membrane_.stable_step() && !scene_.allow_unstable)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("triaxial.membrane_youngs_modulus: {:.4g} Pa is stable up to a step of {:.4g} s, "
                        "found {:.4g} s: take a softer membrane or a smaller time.step, or set "
                        "time.allow_unstable",
                        modulus, membrane_.stable_step(), time_step_.step));
    mobile_ -= 2 * membrane_.around(); // those at the platens go with these
    triaxial_.emplace(t, scene_.material,
                      walls_.point(TriaxialTest::top_wall).z - walls_.point(TriaxialTest::bottom_wall).z);
}

TriaxialTest::Shape Simulation::specimen_shape() const {
    return {walls_.point(TriaxialTest::top_wall).z - walls_.point(TriaxialTest::bottom_wall).z,
            membrane_.volume(), membrane_.mean_radius()};
}

/// Pressure and edges, at the present time.
void Simulation::press_membrane() {
    membrane_.measure(particles_, team_);
    membrane_.compute(particles_, triaxial_->pressure(step_, time_step_.step, specimen_shape()), team_);
}

/// What the grains push with: all that moved the nodes in this sweep, less pressure, edges and drag. Taken in
/// single precision, as the rows that have moved keep it: the same bits whether they have or not.
void Simulation::feel_apparatus() {
    const double half = 0.5 * time_step_.step;
    for (std::size_t n = 0; n < membrane_.nodes(); ++n) {
        const std::uint32_t row = membrane_.row_of_node(n);
        const Body& body = particles_.bodies[row];
        const HalfKick kick =
            net_.acceleration.empty() ? body.half_kick : HalfKick(half * net_.acceleration[row], {});
        Vec3 a = kick.velocity() / half;
        if (viscous_damping_ > 0)
            a += viscous_damping_ * membrane_.velocity(n);
        membrane_.set_push(n, body.velocity.w * (a - scene_.gravity) - membrane_.force(n));
    }
    triaxial_->feel(0.5 * (platen_force(TriaxialTest::bottom_wall) + platen_force(TriaxialTest::top_wall)),
                    membrane_.stress());
}

/// What a platen carries of the grains, N, pushed positive.
double Simulation::platen_force(std::size_t wall) const {
    ExactSum force(record_scale());
    for (const WallContacts::Entry& e : walls_.entries())
        if (e.wall == wall && particles_.species[e.row] == Species::grain)
            force.add(e.force.z);
    return wall == TriaxialTest::bottom_wall ? force.value() : 0.0 - force.value();
}

/// After a move: sets the velocity of the top platen and of the upper ring for the next.
void Simulation::drive_platen() {
    const double v = triaxial_->control(step_ + 1, time_step_.step, specimen_shape());
    walls_.set_velocity(TriaxialTest::top_wall, {0, 0, v});
    for (std::size_t n = 0; n < membrane_.nodes(); ++n)
        if (membrane_.clamped(n)) {
            Body& body = particles_.bodies[membrane_.row_of_node(n)];
            body.velocity.set({0, 0, membrane_.on_top(n) ? v : 0});
            body.half_kick = {};
            if (kernel_.traits.mixed)
                particles_.set_half_motion(membrane_.row_of_node(n));
        }
}

void Simulation::begin_triaxial(Stage::Kind kind) {
    evaluate();
    triaxial_->begin(kind, step_, specimen_shape());
}

TriaxialMeasures Simulation::triaxial_measures() const {
    evaluated();
    const TriaxialTest::Shape shape = specimen_shape();
    TriaxialMeasures m;
    m.height = shape.height;
    m.area = shape.area();
    m.axial_strain = triaxial_->axial_strain(shape);
    m.volumetric_strain = triaxial_->volumetric_strain(shape);
    m.axial_stress_top = platen_force(TriaxialTest::top_wall) / m.area;
    m.axial_stress_bottom = platen_force(TriaxialTest::bottom_wall) / m.area;
    m.axial_stress = 0.5 * (m.axial_stress_top + m.axial_stress_bottom);
    m.confining_stress = membrane_.stress() * shape.outer() / shape.inner();
    m.confining_stress_target = triaxial_->target(step_, time_step_.step);
    return m;
}

bool Simulation::triaxial_done(double time_in_stage) const {
    return triaxial_->done(time_in_stage, triaxial_measures(), rest_state().unbalanced_force,
                           scene_.rest_unbalanced);
}

std::optional<std::uint64_t> Simulation::outside_membrane() const {
    // In sectors between the rings: no grain stands further out than the furthest node near by.
    const std::size_t around = membrane_.around(), rings = membrane_.nodes() / around,
                      sectors = std::max<std::size_t>(6, around / 4),
                      layers = std::max<std::size_t>(1, rings / 4);
    Vec3 axis;
    double lowest = 1e300, highest = -1e300;
    for (std::size_t n = 0; n < membrane_.nodes(); ++n) {
        const Vec3 x = particles_.bodies[membrane_.row_of_node(n)].position.vec();
        axis += x / static_cast<double>(membrane_.nodes());
        lowest = std::min(lowest, x.z);
        highest = std::max(highest, x.z);
    }
    const auto sector_of = [&](const Vec3& x) {
        const double part = std::atan2(x.y - axis.y, x.x - axis.x) / (2 * std::numbers::pi) + 0.5;
        return std::min(sectors - 1, static_cast<std::size_t>(part * static_cast<double>(sectors)));
    };
    const auto layer_of = [&](const Vec3& x) {
        const double part = std::clamp((x.z - lowest) / (highest - lowest), 0.0, 1.0);
        return std::min(layers - 1, static_cast<std::size_t>(part * static_cast<double>(layers)));
    };
    std::vector<double> furthest(sectors * layers, 0);
    for (std::size_t n = 0; n < membrane_.nodes(); ++n) {
        const Vec3 x = particles_.bodies[membrane_.row_of_node(n)].position.vec();
        const std::size_t s = sector_of(x), l = layer_of(x);
        const double rho = std::hypot(x.x - axis.x, x.y - axis.y);
        for (const std::size_t sector : {s, (s + 1) % sectors, (s + sectors - 1) % sectors})
            for (std::size_t layer = l > 0 ? l - 1 : 0; layer <= std::min(l + 1, layers - 1); ++layer)
                furthest[sector * layers + layer] = std::max(furthest[sector * layers + layer], rho);
    }
    std::optional<std::uint64_t> found;
    for (std::uint32_t row = 0; row < particles_.owned; ++row) {
        const Vec3 x = particles_.bodies[row].position.vec();
        if (particles_.species[row] == Species::grain && (!found || particles_.id[row] < *found) &&
            std::hypot(x.x - axis.x, x.y - axis.y) > furthest[sector_of(x) * layers + layer_of(x)])
            found = particles_.id[row];
    }
    return found;
}

} // namespace talus::engine
