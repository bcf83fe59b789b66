// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/sediment.hpp"

#include "base/error.hpp"
#include "base/random.hpp"
#include "contact/constants.hpp"
#include "engine/simulation.hpp"
#include "packing/assemble.hpp"
#include "packing/cloud.hpp"
#include "packing/histories.hpp"
#include "packing/minimise.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <numbers>

namespace talus::packing {

namespace {

/// Sediment above the layer that is copied, in largest radii: its surface is uneven.
constexpr double height_to_spare = 4;
/// Layers that are pushed weigh so much that nothing turns them aside: by 1e-12 of what a grain would be.
constexpr double weight_of_pushed = 1e12;
/// Solid fractions of sediments lie below this.
constexpr double densest_sediment = 0.645;

void check(const SedimentSettings& s) {
    const auto refuse = [](const std::string& what) { throw Error(ExitCode::configuration_invalid, what); };
    const auto positive = [&](const char* key, double value) {
        if (!(value > 0) || !std::isfinite(value))
            refuse(fmt::format("{}: found {}, expected a number above 0", key, value));
    };
    positive("sediment.gravity", s.gravity);
    positive("sediment.alpha", s.alpha);
    positive("sediment.beta", s.beta);
    positive("sediment.initial_fraction", s.initial_fraction);
    positive("sediment.settle_limit", s.settle_limit);
    positive("sediment.settle_unbalanced_force", s.settle_unbalanced_force);
    positive("sediment.settle_speed", s.settle_speed);
    positive("sediment.compression_speed", s.compression_speed);
    positive("sediment.cut_plane", s.cut_plane);
    positive("sediment.round_time", s.round_time);
    if (!(s.stroke >= 0 && s.stroke < 100))
        refuse(fmt::format("sediment.stroke: found {}, expected 0 to 100", s.stroke));
    positive("sediment.saturation", s.saturation);
    if (s.unbalanced_force)
        positive("sediment.unbalanced_force", *s.unbalanced_force);
    if (!(s.overpush >= 0 && s.overpush < s.beta))
        refuse(fmt::format("sediment.overpush: found {}, expected 0 to sediment.beta", s.overpush));
    for (const auto& [key, value] :
         {std::pair{"settle_friction", s.settle_friction}, std::pair{"joint_friction", s.joint_friction},
          std::pair{"joint_thickness", s.joint_thickness}})
        if (!(value >= 0) || !std::isfinite(value))
            refuse(fmt::format("sediment.{}: found {}, expected 0 or more", key, value));
    positive("sediment.kinetic_ratio", s.kinetic_ratio);
    positive("sediment.relax_limit", s.relax_limit);
    if (!(s.sizes.solid_volume_fraction >= 0.56 && s.sizes.solid_volume_fraction <= 0.68))
        refuse(fmt::format(
            "solid_volume_fraction: found {}, expected 0.56 to 0.68: no sediment is compressed to "
            "anything else",
            s.sizes.solid_volume_fraction));
    if (s.homogenise_rounds < 1)
        refuse(fmt::format("sediment.homogenise_rounds: found {}, expected 1 or more", s.homogenise_rounds));
    const double held = 2 * s.beta * s.sizes.radius / s.sizes.box_length;
    if (held > 0.8)
        refuse(fmt::format(
            "sediment.beta: {} radii of {} m hold {:.0f} % of the box at each cut: use a smaller beta "
            "or a smaller radius",
            s.beta, s.sizes.radius, 100 * held));
}

/// Volume of a sphere of radius r about height z below height h.
double volume_below(double z, double r, double h) {
    const double cap = std::clamp(h - z + r, 0.0, 2 * r);
    return std::numbers::pi * cap * cap * (r - cap / 3);
}

double sphere_volume(double r) {
    return 4.0 / 3.0 * std::numbers::pi * r * r * r;
}

/// Grains with what they remember of each other; contacts are those that touch.
struct Bed {
    std::vector<Vec3> position, velocity, angular_velocity; ///< positions inside the box
    std::vector<double> radius;
    ContactTable contacts;

    std::size_t size() const { return position.size(); }
};

enum class Role : std::uint8_t { free, held, pushed };

/// The route; one object makes one box.
class Route {
public:
    Route(const SedimentSettings& settings, ThreadTeam& team, const SedimentObserver& observer,
          const StageObserver& stages)
        : s_(settings), team_(team), observer_(observer), stages_(stages), length_(settings.sizes.box_length),
          fall_(std::sqrt(length_ / settings.gravity)), drawn_(draw_radii(settings.sizes)),
          r_(*std::max_element(drawn_.radius.begin(), drawn_.radius.end())),
          modulus_(contact::effective_youngs_modulus(settings.material, settings.material)) {
        for (const double radius : drawn_.radius)
            mean_radius_ += radius / static_cast<double>(drawn_.radius.size());
    }
    SedimentResult run();

private:
    engine::Scene scene(const Box& box) const;
    Bed settle();
    void cut(const Bed& sediment);
    void press(double way, double too_far, std::vector<Role>& role, double begin, double end);
    void mark_joint();
    double balance() const;
    void compress();
    void shift_origin(double by);
    Box open_column() const {
        return {{0, 0, -length_}, {length_, length_, 2 * length_}, {true, true, false}};
    }
    void homogenise();
    void relax();
    void minimise_energy();
    void write_down(const engine::Simulation& simulation, std::span<const Role> role, const Box& box,
                    double fraction);
    SedimentState state_of(const engine::SavedState& saved, const std::vector<double>& radius,
                           std::span<const Role> role, const Box& box) const;
    void take(const engine::Simulation& simulation);
    std::unique_ptr<engine::Simulation> start(const engine::Scene& scene, std::span<const Role> role,
                                              double push_velocity = 0);
    bool run_until_rest(engine::Simulation& simulation, std::span<const Role> role, const Box& box,
                        double limit, double begin, double end);
    void show(const std::string& name, std::span<const Role> role, const Box& box) const;
    void fail(const std::string& what) {
        if (result_.failure.empty())
            result_.failure = what;
    }
    Box cube() const { return {{0, 0, 0}, {length_, length_, length_}, {true, true, true}}; }
    double time_unit(double falls) const { return falls * fall_; }

    const SedimentSettings& s_;
    ThreadTeam& team_;
    const SedimentObserver& observer_;
    const StageObserver& stages_;
    double length_, fall_;
    Radii drawn_;
    double r_, mean_radius_ = 0, modulus_;
    Bed bed_;
    std::vector<std::uint8_t> layer_; ///< of bed_: 1 for the layer that was put below
    std::vector<std::uint8_t> joint_; ///< of bed_: 1 for grains with less friction for now; empty: none
    ContactTable
        between_held_;  ///< contacts of two that are held: they take no part in a run and come back after it
    ContactTable seam_; ///< contacts of that layer with what it was taken from, through the top face
    SedimentStage stage_ = SedimentStage::sediment;
    double damping_ = 0;   ///< 1/s, viscous, of what runs now
    double time_step_ = 0; ///< s
    double time_ = 0;      ///< s, of the stages before
    std::int64_t steps_ = 0, round_ = 0;
    SedimentResult result_;
};

engine::Scene Route::scene(const Box& box) const {
    engine::Scene scene;
    scene.gravity = {};
    scene.material = s_.material;
    scene.box = box;
    if (time_step_ > 0)
        scene.step = time_step_;
    if (!joint_.empty()) {
        scene.more_materials = {s_.material};
        scene.more_materials[0].friction = s_.joint_friction;
    }
    scene.step_fraction = s_.step_fraction;
    return scene;
}

void append(ContactTable& to, const ContactTable& more) {
    to.pair.insert(to.pair.end(), more.pair.begin(), more.pair.end());
    to.image.insert(to.image.end(), more.image.begin(), more.image.end());
    to.tangential_displacement.insert(to.tangential_displacement.end(), more.tangential_displacement.begin(),
                                      more.tangential_displacement.end());
}

SedimentState Route::state_of(const engine::SavedState& saved, const std::vector<double>& radius,
                              std::span<const Role> role, const Box& box) const {
    SedimentState state;
    state.stage = stage_;
    state.steps = steps_ + saved.step;
    state.round = round_;
    const Vec3 edges = box.lengths();
    double force = 0, virial = 0, elastic = 0, overlaps = 0;
    std::size_t contacts = 0;
    for (std::size_t c = 0; c < saved.contact_pair.size(); ++c) {
        const auto [i, j] = saved.contact_pair[c];
        const auto& image = saved.contact_image[c];
        const Vec3 shift{image[0] * edges.x, image[1] * edges.y, image[2] * edges.z};
        const double distance = norm(saved.position[j] + shift - saved.position[i]),
                     touch = radius[i] + radius[j], overlap = touch - distance;
        if (overlap <= 0)
            continue;
        const double reduced = radius[i] * radius[j] / touch;
        const double f = contact::hertz_stiffness(modulus_, reduced, overlap) * overlap;
        ++contacts;
        overlaps += overlap;
        force += f;
        virial += f * distance;
        elastic += 0.4 * f * overlap;
    }
    double kinetic = 0, net = 0, volume = 0;
    std::size_t free = 0;
    for (std::size_t i = 0; i < radius.size(); ++i) {
        volume += sphere_volume(radius[i]);
        if (role[i] != Role::free)
            continue;
        const double mass = sphere_volume(radius[i]) * s_.material.density;
        kinetic += 0.5 * mass * norm2(saved.half_velocity[i]) +
                   0.2 * mass * radius[i] * radius[i] * norm2(saved.half_angular_velocity[i]);
        // Without the drag: a grain that creeps at the speed where drag and contacts balance is not at rest.
        net += mass * norm(saved.acceleration[i] +
                           damping_ * (saved.half_velocity[i] + saved.half_kick[i].velocity()));
        ++free;
    }
    const auto n = static_cast<double>(radius.size());
    state.coordination_number = 2 * static_cast<double>(contacts) / n;
    state.total_overlap = overlaps;
    if (contacts > 0) {
        state.mean_overlap_ratio = overlaps / static_cast<double>(contacts) / mean_radius_;
        state.kinetic_ratio = kinetic / elastic;
        state.pressure = virial / 3 / (volume / s_.sizes.solid_volume_fraction);
        state.unbalanced_force = net / static_cast<double>(std::max<std::size_t>(1, free)) /
                                 (force / static_cast<double>(contacts));
    }
    return state;
}

void Route::write_down(const engine::Simulation& simulation, std::span<const Role> role, const Box& box,
                       double fraction) {
    SedimentState state = state_of(simulation.save(), bed_.radius, role, box);
    state.time = time_ + simulation.time();
    result_.history.push_back(state);
    result_.end = state;
    if (observer_)
        observer_(state, fraction);
}

/// Positions, velocities and contacts of a simulation become the bed's.
void Route::take(const engine::Simulation& simulation) {
    engine::SavedState saved = simulation.save();
    bed_.position = std::move(saved.position);
    bed_.velocity = std::move(saved.half_velocity);
    bed_.angular_velocity = std::move(saved.half_angular_velocity);
    const double half = 0.5 * time_step_;
    for (std::size_t i = 0; i < bed_.size(); ++i) {
        bed_.velocity[i] += half * saved.acceleration[i];
        bed_.angular_velocity[i] += half * saved.angular_acceleration[i];
    }
    bed_.contacts = contacts_of(saved);
    append(bed_.contacts, between_held_);
    between_held_ = {};
    time_ += simulation.time();
    steps_ += simulation.steps();
}

std::unique_ptr<engine::Simulation> Route::start(const engine::Scene& scene, std::span<const Role> role,
                                                 double push_velocity) {
    Grains grains;
    grains.position = bed_.position;
    grains.radius = bed_.radius;
    grains.velocity = bed_.velocity;
    grains.angular_velocity = bed_.angular_velocity;
    grains.species.assign(bed_.size(), Species::grain);
    grains.mass.resize(bed_.size());
    for (std::size_t i = 0; i < bed_.size(); ++i) {
        grains.mass[i] = sphere_volume(bed_.radius[i]) * s_.material.density;
        if (role[i] == Role::held)
            grains.species[i] = Species::fixed;
        if (role[i] == Role::pushed) {
            grains.mass[i] *= weight_of_pushed;
            grains.velocity[i] = {0, 0, push_velocity};
            grains.angular_velocity[i] = {};
        }
    }
    grains.material = joint_;
    auto simulation = std::make_unique<engine::Simulation>(scene, grains, team_);
    if (s_.material.friction > 0) {
        ContactTable live;
        between_held_ = {};
        for (std::size_t c = 0; c < bed_.contacts.size(); ++c) {
            const auto [i, j] = bed_.contacts.pair[c];
            const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
            const bool both = role[a] != Role::free && role[b] != Role::free &&
                              !(role[a] == Role::pushed && role[b] == Role::pushed);
            const auto& image = bed_.contacts.image[c];
            const Vec3 shift{image[0] * length_, image[1] * length_, image[2] * length_};
            if (!both && norm(bed_.position[b] + shift - bed_.position[a]) >= bed_.radius[a] + bed_.radius[b])
                continue; // parted as the layer was drawn back
            ContactTable& to = both ? between_held_ : live;
            to.pair.push_back(bed_.contacts.pair[c]);
            to.image.push_back(bed_.contacts.image[c]);
            to.tangential_displacement.push_back(bed_.contacts.tangential_displacement[c]);
        }
        simulation->adopt_histories(live);
    }
    return simulation;
}

/// Step 1. Returns the grains at rest on the floor.
Bed Route::settle() {
    stage_ = SedimentStage::sediment;
    const double height = (1 + s_.alpha) * length_ + (s_.beta + height_to_spare) * r_;
    const auto target = static_cast<double>(drawn_.radius.size());
    const auto count = static_cast<std::size_t>(std::ceil(
        target * std::max(densest_sediment / s_.sizes.solid_volume_fraction, 1.0) * height / length_));
    bed_ = {};
    bed_.radius.resize(count);
    double solid = 0;
    for (std::size_t k = 0; k < count; ++k) { // the same distribution, largest first
        const double part = (static_cast<double>(k) + 0.5) / static_cast<double>(count);
        bed_.radius[count - 1 - k] = drawn_.radius[static_cast<std::size_t>(part * target)];
        solid += sphere_volume(bed_.radius[count - 1 - k]);
    }
    const double top = solid / (s_.initial_fraction * length_ * length_) + 2 * r_;
    bed_.position = random_cloud(bed_.radius, length_, top, s_.seed);
    bed_.velocity.resize(count);
    bed_.angular_velocity.assign(count, {});
    Philox random(s_.seed, 2);
    const double speed = s_.initial_speed * length_ / fall_;
    for (Vec3& v : bed_.velocity)
        do
            v = {2 * random.uniform() - 1, 2 * random.uniform() - 1, 2 * random.uniform() - 1};
        while (norm2(v) > 1);
    for (Vec3& v : bed_.velocity)
        v = v * speed;

    const Box box{{0, 0, -length_}, {length_, length_, top + 2 * length_}, {true, true, false}};
    engine::Scene fall = scene(box);
    fall.gravity = {0, 0, -s_.gravity};
    fall.material.friction = std::max(fall.material.friction, s_.settle_friction);
    fall.walls = {
        {.name = "floor", .point = {}, .normal = {0, 0, 1}, .velocity = {}, .material = s_.material}};
    const std::vector<Role> role(count, Role::free);
    const auto running = start(fall, role);
    engine::Simulation& simulation = *running;
    result_.sediment_particles = static_cast<std::int64_t>(count);
    time_step_ = simulation.time_step().step; // the same in all stages

    const double down = std::sqrt(2 * top / s_.gravity) + speed / s_.gravity + 0.5 * fall_;
    const double limit = time_unit(s_.settle_limit);
    const auto interval = std::max<std::int64_t>(1, std::llround(0.1 * fall_ / simulation.time_step().step));
    bool damped = false;
    for (;;) {
        simulation.step();
        if (simulation.steps() % interval != 0)
            continue;
        if (!damped && simulation.time() > down) {
            damping_ = s_.settle_damping / fall_;
            simulation.set_viscous_damping(damping_);
            damped = true;
        }
        write_down(simulation, role, box, 0.5 * std::min(1.0, simulation.time() / (2 * down)));
        const engine::RestState rest = simulation.rest_state();
        if (damped && rest.unbalanced_force < s_.settle_unbalanced_force &&
            rest.rms_speed < s_.settle_speed * s_.compression_speed * length_ / fall_)
            break;
        if (simulation.time() > limit) {
            fail(fmt::format(
                "sediment: unbalanced_force is {:.3g} (limit {:g}) and the speed {:.3g} m/s after {:.3g} "
                "s: allow a larger sediment.settle_limit",
                rest.unbalanced_force, s_.settle_unbalanced_force, rest.rms_speed, limit));
            break;
        }
    }
    take(simulation);
    show("sediment", role, box);
    double within = 0;
    for (std::size_t i = 0; i < count; ++i)
        within += volume_below(bed_.position[i].z, bed_.radius[i], (1 + s_.alpha) * length_) -
                  volume_below(bed_.position[i].z, bed_.radius[i], s_.alpha * length_);
    result_.sediment_fraction = within / std::pow(length_, 3);
    return std::move(bed_);
}

/// Step 2. Slab and layer as they stand before the compression become the bed.
void Route::cut(const Bed& sediment) {
    const double top = (1 + s_.alpha) * length_, bottom = s_.alpha * length_, thickness = s_.beta * r_;
    std::vector<std::uint32_t> below;
    std::vector<Role> taken(sediment.size(), Role::free); // free: not taken; held: slab; pushed: layer
    double volume = 0, above = 0;
    for (std::size_t i = 0; i < sediment.size(); ++i) {
        const double z = sediment.position[i].z;
        if (z < top)
            below.push_back(static_cast<std::uint32_t>(i));
        else if (z < top + thickness) {
            taken[i] = Role::pushed;
            volume += sphere_volume(sediment.radius[i]);
        } else
            ++above;
    }
    if (above == 0 || volume < 0.7 * result_.sediment_fraction * thickness * length_ * length_)
        throw Error(
            ExitCode::quality_not_reached,
            fmt::format(
                "packing not converged: the sediment's solid fraction of {:.3f} leaves too few grains "
                "above {:.3g} m: use another seed or a smaller sediment.alpha or beta",
                result_.sediment_fraction, top));
    std::sort(below.begin(), below.end(), [&](std::uint32_t a, std::uint32_t b) {
        const double za = sediment.position[a].z, zb = sediment.position[b].z;
        return za > zb || (za == zb && a < b);
    });
    // Highest first, until there is as much as the box wants (or as the gamma given says).
    const double wanted = s_.sizes.solid_volume_fraction * std::pow(length_, 3);
    double lowest = top;
    std::size_t k = 0;
    for (; k < below.size(); ++k) {
        const double more = sphere_volume(sediment.radius[below[k]]), z = sediment.position[below[k]].z;
        if (s_.gamma ? z < bottom + (s_.beta - *s_.gamma) * r_ : volume + 0.5 * more > wanted)
            break;
        taken[below[k]] = Role::held;
        volume += more;
        lowest = z;
    }
    if (k == below.size() || lowest < 2 * r_)
        throw Error(
            ExitCode::quality_not_reached,
            fmt::format("packing not converged: the sediment's solid fraction of {:.3f} does not give enough "
                        "grains for {:.4f} down to its floor: use a larger sediment.alpha",
                        result_.sediment_fraction, s_.sizes.solid_volume_fraction));
    const double cut_height = 0.5 * (lowest + sediment.position[below[k]].z);
    const double gamma = s_.gamma.value_or(s_.beta - (cut_height - bottom) / r_);
    result_.gamma = gamma;
    result_.gamma_expected = (s_.sizes.solid_volume_fraction / result_.sediment_fraction - 1) * length_ / r_;

    // Taken by place, sizes are a random draw: each grain gets the radius of its rank, so that the box has
    // the distribution asked for; then all grow by one factor that meets the fraction.
    std::vector<std::uint32_t> by_size;
    for (std::size_t i = 0; i < sediment.size(); ++i)
        if (taken[i] != Role::free)
            by_size.push_back(static_cast<std::uint32_t>(i));
    std::stable_sort(by_size.begin(), by_size.end(), [&](std::uint32_t a, std::uint32_t b) {
        return sediment.radius[a] < sediment.radius[b];
    });
    std::vector<double> radius(sediment.size());
    volume = 0;
    for (std::size_t rank = 0; rank < by_size.size(); ++rank) {
        radius[by_size[rank]] = drawn_.radius[(2 * rank + 1) * drawn_.radius.size() / (2 * by_size.size())];
        volume += sphere_volume(radius[by_size[rank]]);
    }
    const double factor = std::cbrt(wanted / volume);
    result_.last_strain = std::abs(factor - 1) < 1e-12 ? 0 : factor - 1;

    std::vector<std::int64_t> row(sediment.size(), -1);
    bed_ = {};
    layer_.clear();
    for (std::size_t i = 0; i < sediment.size(); ++i) {
        if (taken[i] == Role::free)
            continue;
        const bool layer = taken[i] == Role::pushed;
        row[i] = static_cast<std::int64_t>(bed_.size());
        Vec3 x = sediment.position[i];
        x.z -= layer ? top + (gamma + 1) * r_ : bottom;
        bed_.position.push_back(x);
        bed_.radius.push_back(radius[i] * factor);
        layer_.push_back(layer);
    }
    bed_.velocity.assign(bed_.size(), {});
    bed_.angular_velocity.assign(bed_.size(), {});
    seam_ = {};
    for (std::size_t c = 0; c < sediment.contacts.size(); ++c) {
        const auto [i, j] = sediment.contacts.pair[c];
        const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
        if (row[a] < 0 || row[b] < 0)
            continue;
        auto image = sediment.contacts.image[c];
        ContactTable& to = taken[a] == taken[b] ? bed_.contacts : seam_;
        if (taken[a] != taken[b]) // the layer will stand one box length below where it was
            image[2] = taken[b] == Role::pushed ? 1 : -1;
        to.pair.push_back({row[a], row[b]});
        to.image.push_back(image);
        to.tangential_displacement.push_back(sediment.contacts.tangential_displacement[c]);
    }
}

/// Pushes the bottom layer up by `way` and `too_far` towards the top layer, which is held, then takes back
/// what was too far. Both layers are as thick as beta says.
void Route::press(double way, double too_far, std::vector<Role>& role, double begin, double end) {
    const Box box = open_column();
    role.assign(bed_.size(), Role::free);
    for (std::size_t i = 0; i < bed_.size(); ++i)
        role[i] = layer_[i]                                      ? Role::pushed
                  : bed_.position[i].z >= length_ - s_.beta * r_ ? Role::held
                                                                 : Role::free;
    const std::vector<Vec3> before = bed_.position;
    if (way > 0) { // the sediment may be so much denser than the box that the layer only goes down
        damping_ = 0;
        const double speed = s_.compression_speed * length_ / fall_;
        const auto steps = static_cast<std::int64_t>(std::ceil((way + too_far) / (speed * time_step_)));
        const auto running =
            start(scene(box), role, (way + too_far) / (static_cast<double>(steps) * time_step_));
        engine::Simulation& simulation = *running;
        const std::int64_t interval = std::max<std::int64_t>(1, steps / 20);
        for (std::int64_t step = 1; step <= steps; ++step) {
            simulation.step();
            if (step % interval == 0 || step == steps)
                write_down(simulation, role, box,
                           begin + (end - begin) * static_cast<double>(step) / static_cast<double>(steps));
        }
        take(simulation);
    }
    for (std::size_t i = 0; i < bed_.size(); ++i)
        if (role[i] == Role::pushed) { // to the bit where its image stands above the top
            bed_.position[i] = before[i] + Vec3{0, 0, way};
            bed_.velocity[i] = bed_.angular_velocity[i] = {};
        }
}

/// Step 3: until the layer spans [0, beta r).
void Route::compress() {
    stage_ = SedimentStage::compress;
    std::vector<Role> role;
    if (stages_) {
        press(0, 0, role, 0, 0);
        show("cut", role, open_column());
    }
    if (s_.joint_friction < s_.material.friction)
        mark_joint();
    press((result_.gamma + 1) * r_, s_.overpush * r_, role, 0.5, 0.65);
    show("compressed", role, open_column());
}

/// Grains on both sides of the plane where slab and layer will meet: the slab's bottom comes up by gamma.
void Route::mark_joint() {
    joint_.assign(bed_.size(), 0);
    for (std::size_t i = 0; i < bed_.size(); ++i) {
        const double z = bed_.position[i].z + (result_.gamma + (layer_[i] ? 1 : 0)) * r_;
        joint_[i] = std::abs(z - s_.beta * r_) < s_.joint_thickness * r_;
    }
}

double Route::balance() const {
    const auto grains = static_cast<std::int64_t>(bed_.size());
    return s_.unbalanced_force.value_or(s_.material.friction > 0 ? 1e-4
                                                                 : frictionless_unbalanced_force(grains));
}

/// Moves the origin up by `by` along z, in a cell periodic there; contacts keep who they are.
void Route::shift_origin(double by) {
    std::vector<std::int8_t> wrapped(bed_.size());
    for (std::size_t i = 0; i < bed_.size(); ++i) {
        double& z = bed_.position[i].z;
        z -= by;
        wrapped[i] = static_cast<std::int8_t>(std::floor(z / length_));
        z -= wrapped[i] * length_;
    }
    for (std::size_t c = 0; c < bed_.contacts.size(); ++c) {
        const auto [i, j] = bed_.contacts.pair[c];
        bed_.contacts.image[c][2] =
            static_cast<std::int8_t>(bed_.contacts.image[c][2] + wrapped[static_cast<std::size_t>(j)] -
                                     wrapped[static_cast<std::size_t>(i)]);
    }
}

/// Runs until what may move is in balance, at most for `limit` seconds; whether it is.
bool Route::run_until_rest(engine::Simulation& simulation, std::span<const Role> role, const Box& box,
                           double limit, double begin, double end) {
    const auto interval =
        std::max<std::int64_t>(50, std::llround(0.05 * fall_ / simulation.time_step().step));
    for (;;) {
        simulation.step();
        if (simulation.steps() % interval != 0)
            continue;
        const double before = result_.end.total_overlap;
        write_down(simulation, role, box, begin + (end - begin) * std::min(1.0, simulation.time() / limit));
        const SedimentState& now = result_.end;
        if (now.unbalanced_force < balance() && now.kinetic_ratio < s_.kinetic_ratio &&
            std::abs(now.total_overlap - before) < s_.saturation * before)
            return true;
        if (simulation.time() >= limit)
            return false;
    }
}

/// Step 4.
void Route::homogenise() {
    stage_ = SedimentStage::homogenise;
    const Box box = cube();
    for (Vec3& x : bed_.position)
        x = box.wrap(x);
    append(bed_.contacts, seam_);
    std::vector<Role> role(bed_.size());
    for (round_ = 1; round_ <= s_.homogenise_rounds; ++round_) {
        const auto part = [this](double rounds) {
            return 0.65 + 0.25 * rounds / static_cast<double>(s_.homogenise_rounds);
        };
        const auto done = static_cast<double>(round_ - 1);
        shift_origin(s_.cut_plane * length_);
        for (std::size_t i = 0; i < bed_.size(); ++i) {
            layer_[i] = bed_.position[i].z < s_.beta * r_;
            if (layer_[i])
                bed_.position[i].z -= s_.stroke * r_;
        }
        press(s_.stroke * r_, 0, role, part(done), part(done + 0.5));
        for (Role& r : role)
            if (r == Role::pushed)
                r = Role::held;
        damping_ = s_.relax_damping / fall_;
        const auto running = start(scene(box), role);
        engine::Simulation& simulation = *running;
        simulation.set_viscous_damping(damping_);
        run_until_rest(simulation, role, box, time_unit(s_.round_time), part(done + 0.5), part(done + 1));
        take(simulation);
        joint_.clear();
    }
    round_ = s_.homogenise_rounds;
    show("homogenised", role, box);
}

/// The last relaxation, of all grains.
void Route::relax() {
    stage_ = SedimentStage::relax;
    if (s_.material.friction == 0)
        return minimise_energy();
    const Box box = cube();
    const std::vector<Role> role(bed_.size(), Role::free);
    const auto running = start(scene(box), role);
    engine::Simulation& simulation = *running;
    simulation.set_viscous_damping(damping_);
    const bool at_rest = run_until_rest(simulation, role, box, time_unit(s_.relax_limit), 0.9, 1);
    take(simulation);
    if (!at_rest)
        fail(fmt::format(
            "unbalanced_force is {:.3g} (limit {:g}) and kinetic over elastic energy {:.3g} (limit {:g}) "
            "after {:.3g} s: allow a larger sediment.relax_limit",
            result_.end.unbalanced_force, balance(), result_.end.kinetic_ratio, s_.kinetic_ratio,
            time_unit(s_.relax_limit)));
}

/// Without friction rest is a minimum of the energy, found without waiting for the waves to die.
void Route::minimise_energy() {
    std::vector<Vec3> reduced(bed_.size());
    std::vector<double> radius(bed_.size());
    for (std::size_t i = 0; i < bed_.size(); ++i) {
        reduced[i] = bed_.position[i] / length_;
        radius[i] = bed_.radius[i] / length_;
    }
    SoftSpheres spheres(reduced, radius, team_);
    MinimiseLimits limits;
    limits.unbalanced_force = balance();
    limits.iterations = 400000;
    if (!s_.unbalanced_force && !small_enough_to_wait(static_cast<std::int64_t>(bed_.size())))
        limits.still_balanced = still_balanced;
    const auto note = [&](std::int64_t iteration, const ContactSums& sums) {
        SedimentState state;
        state.stage = stage_;
        state.time = time_;
        state.steps = steps_ + iteration;
        state.round = round_;
        state.coordination_number = 2 * static_cast<double>(sums.contacts) / static_cast<double>(bed_.size());
        state.total_overlap = sums.overlap * length_;
        state.mean_overlap_ratio = sums.mean_overlap() * length_ / mean_radius_;
        state.pressure = sums.virial / 3 * modulus_;
        state.unbalanced_force = sums.unbalanced_force();
        result_.history.push_back(state);
        result_.end = state;
        if (observer_)
            observer_(state, 0.95);
    };
    const Minimum minimum = minimise(spheres, limits, note);
    note(minimum.iterations, minimum.sums);
    steps_ += minimum.iterations;
    for (std::size_t i = 0; i < bed_.size(); ++i)
        bed_.position[i] = spheres.position(i) * length_;
    if (!minimum.converged)
        fail(fmt::format(
            "unbalanced_force is {:.3g} after {} iterations of the last relaxation, above {:g}: use "
            "another seed",
            result_.end.unbalanced_force, minimum.iterations, balance()));
    else if (!minimum.jammed)
        fail(fmt::format(
            "pressure is 0: the grains are not jammed at a solid volume fraction of {}: use a larger one",
            s_.sizes.solid_volume_fraction));
}

void Route::show(const std::string& name, std::span<const Role> role, const Box& box) const {
    if (!stages_)
        return;
    Grains grains;
    grains.position = bed_.position;
    grains.radius = bed_.radius;
    grains.velocity = bed_.velocity;
    for (const Role r : role)
        grains.species.push_back(r == Role::free ? Species::grain : Species::fixed);
    grains.box = box;
    stages_(name, grains);
}

SedimentResult Route::run() {
    result_.radius_factor = drawn_.factor;
    cut(settle());
    compress();
    homogenise();
    relax();
    result_.radius_factor *= 1 + result_.last_strain;

    std::vector<Vec3> reduced(bed_.size());
    std::vector<double> radius(bed_.size());
    for (std::size_t i = 0; i < bed_.size(); ++i) {
        reduced[i] = bed_.position[i] / length_;
        radius[i] = bed_.radius[i] / length_;
    }
    std::vector<std::uint32_t> taken_from;
    result_.box = assemble_box(reduced, radius, length_, s_.material.density, team_, &taken_from);
    if (s_.material.friction > 0)
        give_displacements(result_.box, taken_from, bed_.contacts);
    result_.converged = result_.failure.empty();
    return std::move(result_);
}

} // namespace

SedimentResult sediment(const SedimentSettings& settings, ThreadTeam& team, const SedimentObserver& observer,
                        const StageObserver& stages) {
    check(settings);
    return Route(settings, team, observer, stages).run();
}

SedimentForecast forecast(const SedimentSettings& settings, int threads) {
    check(settings);
    SedimentForecast out;
    out.particles = particle_count(settings.sizes);
    const auto n = static_cast<double>(out.particles);
    const double r = settings.sizes.radius / settings.sizes.box_length;
    const double bed = n * (1 + settings.alpha + (settings.beta + height_to_spare) * r);
    out.sediment_particles = static_cast<std::int64_t>(bed);
    const double fall = std::sqrt(settings.sizes.box_length / settings.gravity);
    const double fraction = settings.step_fraction;
    out.time_step = fraction * contact::rayleigh_time(smallest_radius(settings.sizes), settings.material);
    // Measured: some 10 falls of sediment and 5 of the rest; 60 ns a grain, step and thread; 800 bytes a
    // grain.
    const double steps = fall / out.time_step;
    out.memory = 1e7 + 800 * bed;
    out.file_size = 1e5 + (40 + 3.15 * 51) * n;
    out.seconds = (10 * bed + 5 * n) * steps * 60e-9 / std::max(1.0, 0.9 * threads);
    return out;
}

} // namespace talus::packing
