// SPDX-License-Identifier: GPL-3.0-or-later
/// How a simulation comes to be: grains and constants, first lists and bonds, velocities half a step back.
#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>

namespace talus::engine {

namespace {

/// Least share of a particle in the close list's skin at the start, of the largest radius.
constexpr double first_close_skin = 0.01;

bool needs_tangential(const Scene& scene) {
    bool needs = scene.material.friction > 0 || scene.bond.has_value();
    for (const Material& other : scene.more_materials)
        needs = needs || other.friction > 0;
    for (const Wall& wall : scene.walls)
        needs = needs || wall.material.friction > 0;
    return needs;
}

bool same_sizes(const Grains& grains, const parallel::Communicator& world) {
    const auto all_alike = [&](const std::vector<double>& column) {
        const auto [least, most] = std::minmax_element(column.begin(), column.end());
        constexpr double inf = std::numeric_limits<double>::infinity();
        return world.min(column.empty() ? inf : *least) >= world.max(column.empty() ? -inf : *most);
    };
    const bool radius = all_alike(grains.radius), mass = all_alike(grains.mass);
    return radius && mass;
}

KernelTraits traits_of(const Scene& scene, const Grains& grains, const parallel::Communicator& world) {
    return {.tangential = needs_tangential(scene) || scene.bond.has_value(),
            .bonds = scene.bond.has_value(),
            .offsets = scene.stress_free_start,
            .linear = scene.linear_law.has_value(),
            .one_size = same_sizes(grains, world) && scene.more_materials.empty(),
            .materials = !scene.more_materials.empty(),
            .mixed = scene.mixed_precision};
}

} // namespace

Simulation::Simulation(const Scene& scene, const Grains& grains, ThreadTeam& team,
                       const parallel::Communicator& world)
    : scene_(scene), team_(team), world_(world),
      kernel_(choose_kernel(traits_of(scene, grains, world), scene.reference_kernel)),
      images_(scene.box ? *scene.box : grains.box.value_or(Box{})), domains_(world_), halo_(world_),
      walls_(scene, images_.box(), kernel_.traits.tangential), viscous_damping_(scene.viscous_damping) {
    make_constants();
    set_onsets();
    load(grains);

    if (scene.triaxial)
        make_apparatus(grains);

    if (scene.bond) {
        reach_factor_ = std::max(1.0, scene.bond->bond_initiation_factor);
        for (const contact::Constants& c : constants_.pairs)
            bond_reach_ = std::max(bond_reach_, contact::bond_reach_per_radius(c) * largest_radius_ / 2);
    }
    skin_ = scene.skin * largest_radius_;
    close_skin_ = first_close_skin * largest_radius_;
    const double reach = 2 * largest_radius_ * reach_factor_ + bond_reach_ + skin_;
    for (int k = 0; k < 3; ++k)
        if (images_.box().periodic[static_cast<std::size_t>(k)] && images_.box().lengths()[k] < reach)
            throw Error(
                ExitCode::configuration_invalid,
                fmt::format(
                    "box: its periodic edge {} m is shorter than the reach {} m of the largest grains "
                    "(2 r and the skin): use a larger box or smaller grains",
                    images_.box().lengths()[k], reach));

    // Energies against that of a grain squeezed flat, powers against that much in one step.
    const double scale = record_scale() * largest_radius_, power = scale / time_step_.step;
    for (Integral& integral : integrals_)
        integral = {ExactSum(power), ExactSum(power), ExactSum(power)};
    fractured_ = ExactSum(scale);
    wall_record_ = WallRecord(walls_, record_scale());
    check_monitors();
    tallies_.assign(static_cast<std::size_t>(team.size()),
                    {ExactSum(power), ExactSum(power), ExactSum(scale), 0, {}, ExactSum(record_scale())});
    for (Tally& tally : tallies_)
        tally.virial.fill(ExactSum(scale));
    advanced_.resize(static_cast<std::size_t>(team.size()));

    prepare_sleep();
    cut_domains();
    rebuild(true);
    set_initial_contacts();
    start_from_full_step();
    start_potential_ = energies().potential;
    largest_energy_ = 0;
    start_energy_ = energies().total();
}

/// Velocities are kept at half steps; the given ones belong to the full step, like the histories.
void Simulation::start_from_full_step() {
    compute_forces(0);
    const double half = 0.5 * time_step_.step;
    team_.for_range(particles_.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 &a = net_.acceleration[row], &alpha = net_.angular_acceleration[row];
            ParticleColumns& p = particles_;
            p.bodies[row].velocity.set(p.bodies[row].velocity.vec() - half * a);
            p.bodies[row].angular_velocity.set(p.bodies[row].angular_velocity.vec() - half * alpha);
            p.bodies[row].half_kick = HalfKick(half * a, (half * p.bodies[row].position.w) * alpha);
            if (kernel_.traits.mixed)
                p.set_half_motion(row);
        }
    });
    update_halo();
    images_.update_ghosts(particles_, team_);
}

Simulation::~Simulation() = default;

void Simulation::load(const Grains& grains) {
    const std::size_t n = grains.size();
    const std::vector<std::uint64_t> counts = world_.gather(std::uint64_t{n});
    block_start_.assign(1, 0);
    for (const std::uint64_t count : counts)
        block_start_.push_back(block_start_.back() + count);
    const std::uint64_t first = first_id();
    const auto bad = [first](std::size_t row, const std::string& what) {
        throw Error(ExitCode::input_invalid, fmt::format("particle {}: {}", first + row, what));
    };
    ParticleColumns& p = particles_;
    p.owned = n;
    p.bodies.resize(n);
    p.id.resize(n);
    if (constants_.count > 1)
        p.material.assign(n, 0);
    p.species.assign(n, Species::grain);
    p.release.assign(n, 0);
    p.image.assign(n, {});
    constexpr double inf = std::numeric_limits<double>::infinity();
    std::optional<QuickestGrain> quickest;
    smallest_radius_ = inf;
    for (std::size_t row = 0; row < n; ++row) {
        const double r = grains.radius[row];
        if (!is_finite(grains.position[row]))
            bad(row, "its position is not a number; check what wrote the model");
        if (!(r > 0) || !std::isfinite(r))
            bad(row, fmt::format("its radius {} is not above zero", r));
        const std::size_t kind = grains.material.empty() ? 0 : grains.material[row];
        if (kind >= constants_.count)
            bad(row, fmt::format("its material is number {}, but the scene has {}: add it to `materials`",
                                 kind, constants_.count));
        if (constants_.count > 1)
            p.material[row] = static_cast<std::uint8_t>(kind);
        const Material& material = kind == 0 ? scene_.material : scene_.more_materials[kind - 1];
        const double mass = grains.mass.empty() ? 4.0 / 3.0 * std::numbers::pi * r * r * r * material.density
                                                : grains.mass[row];
        if (!(mass > 0) || !std::isfinite(mass))
            bad(row, fmt::format("its mass {} is not above zero", mass));
        if (!grains.species.empty())
            p.species[row] = grains.species[row];
        if (p.species[row] == Species::membrane && !scene_.triaxial)
            bad(row, "is a membrane particle, which needs a triaxial scene");
        if (!grains.release.empty())
            p.release[row] = grains.release[row];
        const bool fixed = p.species[row] == Species::fixed;
        const Vec3 v = grains.velocity.empty() || fixed ? Vec3{} : grains.velocity[row];
        const Vec3 w = grains.angular_velocity.empty() || fixed ? Vec3{} : grains.angular_velocity[row];
        if (!is_finite(v) || !is_finite(w))
            bad(row, "its velocity is not a number; check what wrote the model");
        p.bodies[row].position = Record(images_.snap(grains.position[row]), r);
        p.bodies[row].velocity = Record(v, mass);
        p.bodies[row].angular_velocity = Record(w, 0.4 * mass * r * r);
        p.bodies[row].half_kick = {};
        p.id[row] = first + row;
        largest_radius_ = std::max(largest_radius_, r);
        smallest_radius_ = std::min(smallest_radius_, r);
        mean_radius_ += r / static_cast<double>(size());
        if (fixed)
            continue;
        ++mobile_;
        const QuickestGrain grain = quickness(scene_, material, r, mass);
        if (!quickest || grain.time < quickest->time)
            quickest = grain;
    }
    if (size() == 0)
        throw Error(ExitCode::input_invalid, "the model has no particles");
    reduce_properties(quickest);
    time_step_ = choose_time_step(scene_, *quickest, kernel_.traits.tangential);
}

/// What is known of this rank's grains becomes what is true of all ranks'.
void Simulation::reduce_properties(std::optional<QuickestGrain>& quickest) {
    struct Properties {
        std::optional<QuickestGrain> quickest;
        double largest, smallest, mean, mass_of_smallest;
        std::size_t mobile;
        Census census;
    } mine{quickest, largest_radius_, smallest_radius_, mean_radius_, 0, mobile_, count_all()};
    for (std::size_t row = 0; row < particles_.owned; ++row)
        if (particles_.bodies[row].position.w == smallest_radius_)
            mine.mass_of_smallest = particles_.bodies[row].velocity.w;
    mobile_ = 0;
    mean_radius_ = 0;
    id_sum_ = 0;
    double mass = 0;
    for (const Properties& other : world_.gather(mine)) {
        largest_radius_ = std::max(largest_radius_, other.largest);
        if (other.smallest <= smallest_radius_) {
            smallest_radius_ = other.smallest;
            mass = std::max(mass, other.mass_of_smallest);
        }
        mean_radius_ += other.mean;
        mobile_ += other.mobile;
        id_sum_ += other.census.ids;
        if (other.quickest && (!quickest || other.quickest->time < quickest->time))
            quickest = other.quickest;
    }
    if (!quickest) // nothing moves
        quickest = quickness(scene_, scene_.material, smallest_radius_, mass);
}

void Simulation::make_constants() {
    const BondMaterial bond = scene_.bond.value_or(BondMaterial{});
    if (scene_.linear_law) {
        if (!scene_.more_materials.empty())
            throw Error(ExitCode::configuration_invalid,
                        "contact.law: the linear law has one material, found several; leave out `materials`");
        constants_.pairs = {contact::make_linear_constants(*scene_.linear_law, scene_.material.friction,
                                                           scene_.separation, scene_.lever_arm)};
        return;
    }
    std::vector<Material> materials{scene_.material};
    materials.insert(materials.end(), scene_.more_materials.begin(), scene_.more_materials.end());
    constants_.count = materials.size();
    constants_.pairs.clear();
    for (const Material& a : materials)
        for (const Material& b : materials) {
            contact::Constants c =
                contact::make_constants(a, b, bond, scene_.damping_rule, scene_.separation, scene_.lever_arm);
            const Material both = contact::interface_of(a, b);
            c.friction = both.friction;
            c.damping = contact::damping_number(both.restitution, scene_.damping_rule);
            constants_.pairs.push_back(c);
        }
}

void Simulation::set_initial_contacts() {
    const double chi = scene_.bond ? scene_.bond->bond_initiation_factor : 0;
    for (std::size_t k = 0; k < list_.size(); ++k) {
        const search::Candidate c = list_.candidates()[k];
        const Record &xi = particles_.bodies[c.i].position, &xj = particles_.bodies[c.j].position;
        const double distance = norm(xj.vec() - xi.vec()), touch = xi.w + xj.w;
        if (distance < 1e-9 * touch)
            throw Error(
                ExitCode::input_invalid,
                fmt::format(
                    "particles {} and {}: have the same position, so there is no direction to push them "
                    "apart; check what wrote the model",
                    particles_.id[c.i], particles_.id[c.j]));
        const auto of_membrane = [&](std::uint32_t row) {
            return particles_.species[particles_.owner(row)] == Species::membrane;
        };
        const bool bonded =
            kernel_.traits.bonds && distance < touch * chi && !of_membrane(c.i) && !of_membrane(c.j);
        if (bonded)
            pairs_.state[k] |= contact::bond_intact;
        if (kernel_.traits.offsets && (bonded || distance < touch)) {
            pairs_.offset[k] = touch - distance;
            pairs_.state[k] |= contact::contact_active;
        }
    }
    if (scene_.stress_free_start)
        walls_.set_stress_free(particles_);
}

} // namespace talus::engine
