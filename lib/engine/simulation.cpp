// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/simulation.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>
#include <time.h>

namespace talus::engine {

namespace {

/// Pairs are cut among threads in multiples of this.
constexpr std::size_t pair_block = 64;

/// Least share of a particle in the close list's skin at the start, of the largest radius.
constexpr double first_close_skin = 0.01;

/// No particle may move further in one step than this part of the smallest radius: it could pass another
/// unseen.
constexpr double longest_move = 0.5;

bool needs_tangential(const Scene& scene) {
    bool needs = scene.material.friction > 0 || scene.bond.has_value();
    for (const Material& other : scene.more_materials)
        needs = needs || other.friction > 0;
    for (const PlaneWall& wall : scene.walls)
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

/// Processor time of this thread, s: what it computed, however many others want the processor.
double seconds_of_thread() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

} // namespace

Simulation::Simulation(const Scene& scene, const Grains& grains, ThreadTeam& team,
                       const parallel::Communicator& world)
    : scene_(scene), team_(team), world_(world),
      kernel_(choose_kernel(traits_of(scene, grains, world), scene.reference_kernel)),
      images_(scene.box ? *scene.box : grains.box.value_or(Box{})), domains_(world_), halo_(world_),
      walls_(scene, kernel_.traits.tangential), viscous_damping_(scene.viscous_damping) {
    make_constants();
    load(grains);

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
    tallies_.assign(static_cast<std::size_t>(team.size()),
                    {ExactSum(power), ExactSum(power), ExactSum(scale), 0, {}, ExactSum(record_scale())});
    advanced_.resize(static_cast<std::size_t>(team.size()));

    cut_domains();
    rebuild(true);
    set_initial_contacts();
    compute_forces(0);
    // Velocities are kept at half steps; the given ones belong to the start.
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
    start_potential_ = energies().potential;
    largest_energy_ = 0;
    start_energy_ = energies().total();
}

Simulation::~Simulation() = default;

void Simulation::load(const Grains& grains) {
    const std::size_t n = grains.size();
    const std::vector<std::uint64_t> counts = world_.gather(std::uint64_t{n});
    block_start_.assign(1, 0);
    for (const std::uint64_t count : counts)
        block_start_.push_back(block_start_.back() + count);
    total_ = block_start_.back();
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
        if (p.species[row] == Species::membrane)
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
        mean_radius_ += r / static_cast<double>(total_);
        if (fixed)
            continue;
        ++mobile_;
        const QuickestGrain grain = quickness(scene_, material, r, mass);
        if (!quickest || grain.time < quickest->time)
            quickest = grain;
    }
    if (total_ == 0)
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
        const bool bonded = kernel_.traits.bonds && distance < touch * chi;
        if (bonded)
            pairs_.state[k] |= contact::bond_intact;
        if (kernel_.traits.offsets && (bonded || distance < touch)) {
            pairs_.offset[k] = touch - distance;
            pairs_.state[k] |= contact::contact_active;
        }
    }
    intact_bonds_ = count_bonds();
    if (scene_.stress_free_start)
        walls_.set_stress_free(particles_);
}

void Simulation::step() {
    const double start = world_.alone() ? 0 : seconds_of_thread();
    if (current_)
        move();
    else
        for_blocks(time_step_.step, advance_work(nullptr, nullptr), false);
    current_ = false;
    finish_move();
    ++step_;
    if (!world_.alone())
        times_.busy += seconds_of_thread() - start;
    keep_lists_valid();
}

void Simulation::evaluate() {
    if (!current_)
        compute_forces(time_step_.step);
}

AdvanceWork Simulation::advance_work(const NetColumns* given, NetColumns* into) {
    return {.particles = particles_,
            .pairs = pairs_,
            .list = list_,
            .walls = walls_,
            .given = given,
            .into = into,
            .gravity = scene_.gravity,
            .step = time_step_.step,
            .viscous_damping = viscous_damping_,
            .rounding = images_.rounding(),
            .tangential = kernel_.traits.tangential,
            .hold = hold_.data(),
            .share = share_.data(),
            .motion = motion_};
}

/// Takes each particle from t to t + dt, where what acts on it is known.
void Simulation::move() {
    const AdvanceWork work = advance_work(&net_, nullptr);
    team_.for_range(particles_.owned, [&](std::size_t begin, std::size_t end, int thread) {
        advance(work, begin, end, advanced_[static_cast<std::size_t>(thread)]);
    });
    move_late(work);
    net_ = {};
}

void Simulation::move_late(const AdvanceWork& work) {
    team_.for_parts(late_.size(), particles_.owned, [&](std::size_t begin, std::size_t end, bool, int) {
        for (std::size_t k = begin; k < end; ++k)
            advance_late(work, late_[k], advanced_[k]);
    });
}

/// Forces at t and the move to t + dt that they cause (or their sums, see AdvanceWork), block by block: a row
/// is moved once all its pairs are done, which then are still in the cache. Nothing else reads it after that:
/// all pairs of a row that is not late belong to its thread.
void Simulation::for_blocks(double history_step, const AdvanceWork& work, bool add_forces) {
    for (Tally& tally : tallies_) {
        tally.dissipation.reset();
        tally.intake.reset();
        tally.fracture.reset();
        tally.contact_force.reset();
        tally.contacts = 0;
    }
    walls_.compute(particles_, history_step, team_, tallies_);
    if (viscous_damping_ > 0)
        add_viscous_power();
    for_sweep_parts(
        [&](std::size_t begin, std::size_t end, std::size_t row, std::size_t last_row, int thread) {
            const auto t = static_cast<std::size_t>(thread);
            for (std::size_t k = begin; k < end; k += sweep_block) {
                const std::size_t done = std::min(k + sweep_block, end), block = k / sweep_block;
                const PairWork pairs{constants_,   particles_, list_.candidates(),
                                     history_step, pairs_,     first_slot(t, block)};
                kernel_.run(pairs, k, done, tallies_[t]);
                for (std::size_t f = far_start_[block]; f < far_start_[block + 1]; ++f)
                    pairs_.copy_record(pairs.first_slot + far_pairs_[f] - k, list_.labels()[far_pairs_[f]]);
                if (add_forces)
                    for (std::size_t pair = k; pair < done; ++pair)
                        if ((pairs_.state[pair] & (contact::contact_active | counted_elsewhere)) ==
                            contact::contact_active)
                            tallies_[t].contact_force.add(norm(pairs_.force_in(pairs.first_slot + pair - k)));
                const std::size_t complete = std::clamp(complete_rows_[done / sweep_block], row, last_row);
                advance(work, row, complete, advanced_[t]);
                row = complete;
            }
            advance(work, row, last_row, advanced_[t]);
        });
    move_late(work);
    collect_tallies(history_step == 0);
}

void Simulation::compute_forces(double history_step) {
    net_.resize(particles_.owned);
    for (std::size_t row = 0; row < particles_.owned; ++row) // fixed rows are not summed up
        if (particles_.species[row] == Species::fixed)
            net_.acceleration[row] = net_.angular_acceleration[row] = {};
    for_blocks(history_step, advance_work(nullptr, &net_), true);
    contact_force_ = ExactSum(record_scale());
    for (const Tally& tally : tallies_)
        contact_force_.add(tally.contact_force);
    current_ = true;
}

/// A force, N, that sums of forces are measured against.
double Simulation::record_scale() const {
    if (scene_.linear_law)
        return scene_.linear_law->normal_stiffness * largest_radius_;
    double stiffest = scene_.material.youngs_modulus;
    for (const Material& other : scene_.more_materials)
        stiffest = std::max(stiffest, other.youngs_modulus);
    return stiffest * largest_radius_ * largest_radius_;
}

/// Looks at how far the particles moved.
void Simulation::finish_move() {
    const double dt = time_step_.step;
    walls_.move(dt);
    double speed2 = 0, use2 = 0;
    bool finite = true;
    for (Advanced& part : advanced_) {
        speed2 = std::max(speed2, part.largest_speed2);
        use2 = std::max(use2, part.largest_use2);
        finite = finite && part.finite;
        part.largest_speed2 = part.largest_use2 = 0;
        part.finite = true;
    }
    if (!finite)
        stop_at_bad_particle();
    if (dt * std::sqrt(speed2) > longest_move * smallest_radius_)
        check_passing();
    used_ += dt * (std::sqrt(use2) + shear_use_);
    wall_travel_ += dt * walls_.fastest();
    if (walls_.any())
        wall_used_ += dt * (std::sqrt(speed2) + walls_.fastest());
}

std::string Simulation::near_particles(std::size_t row) const {
    std::string partners;
    for (const search::Candidate& c : list_.candidates()) {
        if (particles_.owner(c.i) == row)
            partners += fmt::format(" {}", particles_.id[c.j]);
        else if (particles_.owner(c.j) == row)
            partners += fmt::format(" {}", particles_.id[c.i]);
    }
    return partners.empty() ? "near no other" : "near particles" + partners;
}

void Simulation::stop_at_bad_particle() const {
    const ParticleColumns& p = particles_;
    for (std::size_t row = 0; row < p.owned; ++row) {
        const Vec3 v = p.bodies[row].velocity.vec(), w = p.bodies[row].angular_velocity.vec();
        if (!(norm2(v) < 1e300) || !is_finite(w) || !(norm2(w) < 1e300))
            throw Error(
                ExitCode::run_failed,
                fmt::format("particle {}: its velocity is no longer a number, or beyond all bounds, at step "
                            "{} (t = {:.6g} s), {}: take a smaller time.step",
                            p.id[row], step_ + 1, time(), near_particles(row)));
    }
    throw Error(
        ExitCode::run_failed,
        fmt::format("a velocity is no longer a number at step {} (t = {:.6g} s): take a smaller time.step",
                    step_ + 1, time()));
}

/// Somebody moved by more than half the smallest radius in this step. That is no harm where nobody was in the
/// way; but two particles that met on the way would not have seen each other, or far too late.
/// @throws Error(run_failed) for such a pair
void Simulation::check_passing() const {
    const ParticleColumns& p = particles_;
    const double dt = time_step_.step, allowed = longest_move * smallest_radius_;
    const Vec3 edges = images_.box().lengths();
    std::vector<std::uint32_t> fast;
    for (std::uint32_t row = 0; row < p.owned; ++row)
        if (dt * norm(p.bodies[row].velocity.vec()) > allowed)
            fast.push_back(row);
    const auto stop = [&](std::uint32_t i, const std::string& how) {
        throw Error(
            ExitCode::run_failed,
            fmt::format("particle {}: moves {:.3g} of the smallest radius in step {} (t = {:.6g} s, {:.4g} "
                        "m/s) {}: take a smaller time.step",
                        p.id[i], dt * norm(p.bodies[i].velocity.vec()) / smallest_radius_, step_ + 1, time(),
                        norm(p.bodies[i].velocity.vec()), how));
    };
    if (fast.size() > 200'000'000 / p.owned + 1)
        stop(fast.front(), fmt::format("as {} others do, and may pass particles unseen", fast.size() - 1));
    for (const std::uint32_t i : fast) {
        const Vec3 x = p.bodies[i].position.vec(), move = dt * p.bodies[i].velocity.vec();
        if (norm(move) > 1e6 * smallest_radius_)
            stop(i, "beyond all bounds");
        if (!world_.alone() && norm(move) > 2 * largest_outer_share())
            stop(i, "further than its rank sees the particles of other ranks");
        if (walls_.reached(x, p.bodies[i].position.w, move, allowed))
            stop(i, "into a wall");
        for (std::uint32_t j = 0; j < p.known(); ++j) {
            const Vec3 way =
                dt * (p.bodies[j].velocity.vec() - p.bodies[i].velocity.vec()); // of j seen from i
            const double length2 = norm2(way);
            if (j == i || length2 <= allowed * allowed)
                continue;
            Vec3 end = p.bodies[j].position.vec() - p.bodies[i].position.vec();
            for (int k = 0; k < 3; ++k)
                if (images_.box().periodic[static_cast<std::size_t>(k)])
                    end[k] -= std::round(end[k] / edges[k]) * edges[k];
            const double back =
                std::clamp(dot(end, way) / length2, 0.0, 1.0); // nearest this part of the step ago
            if (norm(end - back * way) < p.bodies[i].position.w + p.bodies[j].position.w && back > 0)
                stop(i, fmt::format("and meets particle {} on its way", p.id[j]));
        }
    }
}

} // namespace talus::engine
