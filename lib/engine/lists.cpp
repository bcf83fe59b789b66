// SPDX-License-Identifier: GPL-3.0-or-later
/// The simulation's lists of near pairs: when they hold, when and how they are made anew.
#include "base/error.hpp"
#include "engine/simulation.hpp"
#include "search/bounds.hpp"
#include "search/ordering.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <limits>
#include <numeric>
#include <utility>

namespace talus::engine {

namespace {

/// Particles are put back into space-filling order with every so many lists: neighbours drift apart slowly.
constexpr std::size_t rebuilds_per_reorder = 4;

/// A list is kept on where really no more than this part of its skin is used up.
constexpr double worn_out = 0.7;

/// The outer skin grows to at most so many times the scene's, and a fast particle's share of it; where lists
/// wear out in so few steps and have so few pairs a particle that moves (a thin, quick flow) to so many times
/// that.
constexpr double widest = 2, widest_share = 7;
constexpr std::int64_t short_lived = 30;
constexpr double few_pairs = 9, widening = 8;

/// Steps that a particle's share of the outer skin lasts at its present speed.
constexpr double outer_share_steps = 150;

/// Steps that a particle's share of the close skin lasts at its present speed.
constexpr double share_steps = 50;

/// Particles go their own ways (search::LocalMotion) where the widest share of the outer skin would last the
/// quickest less than so many steps. Lists then look so many steps ahead, about as many as they last.
constexpr double own_ways_below = 12;
constexpr std::int64_t least_ahead = 5, most_ahead = 40;

/// By a hit, a particle takes on such a part of the velocity of the quickest around.
constexpr double hit_share = 0.5;

/// The local motion counts where it takes more than this part of the close skin meanwhile.
constexpr double slow = 0.2;

/// What the ranks tell each other after each step; above these come what the outside asks for.
enum : unsigned { outer_list_is_worn = 1, close_list_is_worn = 2 };
constexpr unsigned own_bits = 2;

/// A particle's share of the close skin is at most this part of its share of the outer one: some lists of
/// close pairs are made of one outer one.
constexpr double largest_share = 0.4;

double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

} // namespace

/// Displacement since the outer list was made; where space is stretched, of what the particle's position was
/// in the box of then.
Vec3 Simulation::moved_since_listed(std::size_t row) const {
    const std::array<float, 3>& from = listed_[row];
    Vec3 x = particles_.bodies[row].position.vec();
    if (straining_) {
        const Vec3 &lower = images_.box().lower, d = x - lower, &f = strain_since_rebuild_;
        x = lower + Vec3{d.x / f.x, d.y / f.y, d.z / f.z};
    }
    return x - listed_origin_ - Vec3{from[0], from[1], from[2]};
}

/// By how much lengths of the box as it was must have been longer than the same lengths now, at most.
double Simulation::shortened(const Vec3& factor) {
    return 1 / std::min({factor.x, factor.y, factor.z, 1.0}) - 1;
}

/// Half of the longest pair that may touch or hold, m.
double Simulation::half_reach() const {
    return largest_radius_ * reach_factor_ + 0.5 * bond_reach_;
}

/// Displacement since the outer list was made, less what the local motion would have made of it.
Vec3 Simulation::moved_against_others(std::size_t row) const {
    const double since = static_cast<double>(step_ - last_rebuild_) * time_step_.step;
    return moved_since_listed(row) - since * motion_.of(row).velocity();
}

/// No particle's share of the outer skin is larger (m).
double Simulation::largest_outer_share() const {
    double most = 0.5 * widest_share * scene_.skin * largest_radius_ * wider_;
    if (sleep_) // what is in the store is a cell away: half of what lies between is for its way here
        most =
            std::min(most, 0.25 * (sleep_->cells.edge() - 2 * largest_radius_ * reach_factor_ - bond_reach_));
    for (int k = 0; k < 3; ++k)
        if (images_.box().periodic[static_cast<std::size_t>(k)])
            most = std::min(
                most, 0.5 * (images_.box().lengths()[k] - 2 * largest_radius_ * reach_factor_ - bond_reach_));
    return most;
}

/// Particles that collide wear out lists in some steps where these follow the mean motion around each. They
/// go their own ways then.
void Simulation::choose_ways() {
    if (motion_.still() || !world_.alone() || straining_ || membrane_.any() || images_.any())
        return;
    const ParticleColumns& p = particles_;
    std::vector<double> parts(static_cast<std::size_t>(team_.size()), 0);
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        double largest = 0;
        for (std::size_t row = begin; row < end; ++row) {
            const search::LocalMotion::Cell cell = motion_.of(row);
            const Vec3 velocity = p.species[row] == Species::fixed ? Vec3{} : p.bodies[row].velocity.vec();
            largest = std::max(largest, norm(velocity - cell.velocity()) + cell.shear);
        }
        parts[static_cast<std::size_t>(thread)] = largest;
    });
    // Who is too quick by far is nobody to look ahead for: the next step ends the run.
    const double way = own_ways_below * time_step_.step * *std::max_element(parts.begin(), parts.end());
    if (way > largest_outer_share() && way < 1e6 * largest_radius_)
        motion_.set_own(p, team_);
}

search::CandidateList::Ahead Simulation::ahead() const {
    return {motion_, motion_.own() ? static_cast<double>(steps_ahead_) * time_step_.step : 0};
}

/// What a particle may move aside while lists last because it is hit (m).
double Simulation::hit_way(std::size_t row) const {
    return motion_.own()
               ? hit_share * static_cast<double>(steps_ahead_) * time_step_.step * motion_.agitation(row)
               : 0;
}

/// Each particle has its share of the lists' skins: what it may move against the local motion until the list
/// is made anew, more where it is fast. So a few fast particles do not make the lists of all the others long
/// or short-lived.
void Simulation::set_outer_shares() {
    const ParticleColumns& p = particles_;
    const double most = largest_outer_share(), dt = outer_share_steps * time_step_.step;
    outer_share_.resize(p.known());
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const search::LocalMotion::Cell cell = motion_.of(row);
            const bool fixed = p.species[row] == Species::fixed;
            const Vec3 velocity = fixed ? Vec3{} : p.bodies[row].velocity.vec();
            const double speed = norm(velocity - cell.velocity()) + cell.shear;
            outer_share_[row] =
                fixed && speed == 0
                    ? 0.0f
                    : static_cast<float>(std::min(most, 0.5 * skin_ + dt * speed + hit_way(row)));
        }
    });
    if (!world_.alone())
        halo_.fill(p, outer_share_);
}

/// The same for the close list.
void Simulation::set_shares() {
    const ParticleColumns& p = particles_;
    const double dt = share_steps * time_step_.step;
    share_.resize(p.known());
    const auto threads = static_cast<std::size_t>(team_.size());
    std::vector<double> use(threads), least(threads, std::numeric_limits<double>::infinity());
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        double largest = 0, smallest = std::numeric_limits<double>::infinity();
        for (std::size_t row = begin; row < end; ++row) {
            const search::LocalMotion::Cell cell = motion_.of(row);
            const bool fixed = p.species[row] == Species::fixed;
            const Vec3 velocity = fixed ? Vec3{} : p.bodies[row].velocity.vec();
            const double against = norm(velocity - cell.velocity()), speed = against + cell.shear;
            share_[row] = motion_.own() ? outer_share_[row]
                                        : static_cast<float>(std::min(largest_share * outer_share_[row],
                                                                      close_skin_ + dt * speed));
            if (share_[row] > 0) // fixed ones are not looked at in every step
                largest = std::max(largest, (fixed ? speed : double{cell.shear}) / share_[row]);
            smallest = std::min(smallest, double{share_[row]});
        }
        use[static_cast<std::size_t>(thread)] = largest;
        least[static_cast<std::size_t>(thread)] = smallest;
    });
    shear_use_ = *std::max_element(use.begin(), use.end());
    least_share_ = *std::min_element(least.begin(), least.end());
    used_ = 0;
    if (!world_.alone())
        halo_.fill(p, share_);
}

/// The most that has been used up of the lists' skins, by how far particles really went.
Simulation::Displacement Simulation::largest_displacement() {
    const auto threads = static_cast<std::size_t>(team_.size());
    std::vector<Displacement> parts(threads);
    const double since = static_cast<double>(step_ - last_rebuild_) * time_step_.step,
                 since_refresh = static_cast<double>(step_ - last_refresh_) * time_step_.step;
    // A pair that touches now was longer by so much in the box of then; each particle pays for half of it.
    const Vec3 &f = strain_since_rebuild_, &g = strain_since_refresh_;
    const double outer_shortened = shortened(f), close_shortened = shortened(g);
    // Displacements are in the box of when the outer list was made, those since the close list in its box.
    const double stretched = std::max({f.x / g.x, f.y / g.y, f.z / g.z});
    const double outer_strain = outer_shortened * half_reach(), strain = close_shortened * half_reach();
    const double spare = motion_.own() ? 0 : 1; // the close list is the outer one there
    team_.for_range(particles_.owned, [&](std::size_t begin, std::size_t end, int thread) {
        Displacement& largest = parts[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            if (share_[row] == 0) // nothing moves there
                continue;
            const Vec3 moved = moved_since_listed(row);
            const search::LocalMotion::Cell cell = motion_.of(row);
            const Vec3 against = moved - since * cell.velocity();
            const std::array<float, 3>& before = refreshed_[row];
            largest.outer =
                std::max(largest.outer, (norm(against) + since * cell.shear + listed_rounding_ +
                                         outer_strain + spare * (1 + outer_shortened) * share_[row]) /
                                            outer_share_[row]);
            const double since_close = norm(against - Vec3{before[0], before[1], before[2]});
            largest.used = std::max(
                largest.used, (stretched * since_close + since_refresh * cell.shear + strain) / share_[row]);
            largest.walls =
                std::max(largest.walls, walls_.approach(moved, particles_.bodies[row].position, wall_skin_));
        }
    });
    Displacement largest;
    for (const Displacement& part : parts) {
        largest.outer = std::max(largest.outer, part.outer);
        largest.used = std::max(largest.used, part.used);
        largest.walls = std::max(largest.walls, part.walls);
    }
    largest.walls += listed_rounding_;
    return largest;
}

/// The close list holds while nobody has moved by more than his share; the outer list has to hold until the
/// close list is made the next time. Whether they can have is first judged by the sum of the largest speeds,
/// which costs nothing; where that runs out, by how far they really went.
void Simulation::keep_lists_valid() {
    unsigned bits = 0;
    if (static_cast<double>(step_ - last_rebuild_) * time_step_.step > motion_holds_for_ ||
        (motion_.own() && step_ - last_rebuild_ > steps_ahead_) || (sleep_ && sleep_->wanted)) {
        bits = outer_list_is_worn;
    } else if (used_ > 1 || wall_used_ > wall_skin_) {
        const Displacement moved = largest_displacement();
        wall_used_ = moved.walls + wall_travel_;
        if (moved.outer > 1 || (walls_.any() && wall_used_ > worn_out * wall_skin_))
            bits = outer_list_is_worn;
        else if (!motion_.own() && moved.used > worn_out)
            bits = close_list_is_worn;
        else
            used_ = moved.used;
    }
    bits = agree(bits);
    if (bits == 0)
        return;
    const double start = wall_seconds();
    if (bits & outer_list_is_worn) {
        rebuild(false);
    } else {
        update_halo();
        images_.update_ghosts(particles_, team_);
        refresh();
    }
    lists_time_ += wall_seconds() - start;
}

/// All ranks learn what any asks for, while close ghosts are brought up.
unsigned Simulation::agree(unsigned bits) {
    const unsigned asking = std::exchange(asking_, 0u);
    if (world_.alone()) {
        asked_ = asking;
        if (bits == 0)
            images_.update_ghosts(particles_, close_ghosts_, team_);
        return bits;
    }
    const double start = wall_seconds();
    halo_.start_update(particles_, false, bits | asking << own_bits);
    images_.update_ghosts(particles_, close_ghosts_, team_); // meanwhile
    const unsigned all = halo_.finish_update(particles_);
    exchange_time_ += wall_seconds() - start;
    asked_ = all >> own_bits;
    return all & ((1u << own_bits) - 1);
}

void Simulation::update_halo() {
    if (!world_.alone())
        halo_.update(particles_);
}

/// Takes wider skins where lists last a few steps only (flow) and narrower ones where they last long (rest).
/// What the forces are does not depend on them.
void Simulation::adapt_skins(bool outer) {
    const auto adapt = [&](double skin, std::int64_t lasted, std::int64_t least, std::int64_t most) {
        return lasted < least ? 1.25 * skin : (lasted > most ? 0.8 * skin : skin);
    };
    const bool worn = rebuilds_ > 0 && !(sleep_ && sleep_->wanted); // else made for sleepers
    if (outer) {
        const bool own = motion_.own();
        if (worn && own) { // as many steps as the lists last
            const std::int64_t lasted = step_ - last_rebuild_;
            steps_ahead_ =
                std::clamp(lasted > steps_ahead_ ? steps_ahead_ + 1 : lasted + 1, least_ahead, most_ahead);
        }
        if (worn && !own)
            skin_ = adapt(skin_, step_ - last_rebuild_, 150, 1000);
        if (worn && !own && world_.alone() && !membrane_.any()) {
            const auto pairs = static_cast<double>(list_.outer_size()),
                       moving = static_cast<double>(
                           std::max<std::size_t>(mobile_ - (sleep_ ? sleep_->count : 0), 1));
            if (step_ - last_rebuild_ < short_lived && pairs < few_pairs * moving)
                wider_ = std::min(1.25 * wider_, widening);
            else if (step_ - last_rebuild_ > 4 * short_lived || pairs > 1.5 * few_pairs * moving)
                wider_ = std::max(0.8 * wider_, 1.0);
        }
        last_rebuild_ = step_;
        skin_ = std::min(
            std::clamp(skin_, 0.5 * scene_.skin * largest_radius_, widest * scene_.skin * largest_radius_),
            2 * largest_outer_share());
    } else {
        close_skin_ = adapt(close_skin_, step_ - last_refresh_, 30, 100);
    }
    last_refresh_ = step_;
    close_skin_ = std::clamp(close_skin_, 0.002 * largest_radius_, 0.5 * largest_share * skin_);
}

search::CandidateList::Live Simulation::live() const {
    return {{pairs_.state.data(), pairs_.state.size()},
            contact::contact_active | contact::bond_intact,
            contact::bond_intact,
            {pairs_.offset.data(), pairs_.offset.size()}};
}

/// `all_bonds`: also pairs that may be bonded but are not known to be yet are close ones.
/// `carried`: histories that are given instead of those in the present list.
void Simulation::rebuild(bool all_bonds, Carried carried) {
    ParticleColumns& p = particles_;
    const bool first = rebuilds_ == 0;
    adapt_skins(true);
    const Census before = count_all();
    const std::size_t old_owned = p.owned;
    std::vector<std::array<std::int8_t, 3>> wrapped;
    const bool regroups = sleep_ && sleep_->wanted;
    if (regroups)
        settle_balances(1);
    images_.wrap(p, wrapped);
    std::vector<std::uint32_t> order; // the row that each had before
    if (world_.alone() || carried.restored) {
        order.resize(p.owned);
        std::iota(order.begin(), order.end(), 0u);
    } else {
        order = change_ranks(wrapped, carried);
    }
    if (sleep_ && !first && !carried.restored)
        order = regroup(wrapped, carried);
    if (rebuilds_ % rebuilds_per_reorder == 0) {
        const std::vector<std::uint32_t> sorted = search::space_filling_order(p, 2.5 * mean_radius_, team_);
        search::reorder(p, sorted, team_);
        const auto wrapped_before = wrapped;
        const auto order_before = order;
        team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
            for (std::size_t row = begin; row < end; ++row) {
                wrapped[row] = wrapped_before[sorted[row]];
                order[row] = order_before[sorted[row]];
            }
        });
    }
    for (active_ = p.owned; active_ > 0 && p.species[active_ - 1] == Species::fixed;)
        --active_;
    if (sleep_) {
        sleep_->asleep_row.resize(p.owned);
        for (std::uint32_t row = 0; row < p.owned; ++row) {
            sleep_->asleep_row[row] = is_asleep(row);
            sleep_->row_of[p.id[row]] = row;
        }
    }
    const double touch = 2 * largest_radius_ * reach_factor_ + bond_reach_;
    if (!world_.alone())
        halo_.make(p, images_.box(), touch + 2 * largest_outer_share());
    const bool moves =
        motion_.build(p, images_.box(), touch + 2 * largest_outer_share(), 2 * largest_outer_share(),
                      slow * close_skin_ / (share_steps * time_step_.step), team_);
    double unseen = std::numeric_limits<double>::infinity(); // s, until sleepers in the store may be reached
    if (world_.any(moves && !straining_)) {                  // a cell's velocity would not stay what it is
        if (sleep_)
            unseen = sleepers_unseen_for(touch + 2 * largest_outer_share());
        share_motion();
    } else {
        motion_.set_still();
    }
    motion_holds_for_ = world_.min(std::min(motion_.holds_for(), unseen));
    choose_ways();
    if (motion_.own())
        motion_holds_for_ =
            sleep_ && motion_.fastest() > 0
                ? (sleep_->cells.edge() - touch - 2 * largest_outer_share()) / motion_.fastest()
                : std::numeric_limits<double>::infinity();
    set_outer_shares();
    if (kernel_.traits.mixed) {
        p.half_motion.resize(p.known());
        for (std::size_t row = 0; row < p.known(); ++row)
            p.set_half_motion(row);
    }
    const auto own_end = outer_share_.begin() + static_cast<std::ptrdiff_t>(p.owned);
    wall_skin_ = p.owned == 0 ? 0 : 2.0 * *std::max_element(outer_share_.begin(), own_end);
    images_.make_ghosts(p, touch + wall_skin_);
    if (motion_.own())
        wall_skin_ += ahead().time * motion_.fastest();
    if (first)
        order.clear();
    set_shares();
    const double close_factor = all_bonds ? reach_factor_ : 1;
    if (all_bonds)
        for (float& share : share_)
            share += static_cast<float>(bond_reach_);
    std::vector<search::KeyedPair> keys;
    if (!carried.pairs.empty()) { // they stand behind the present list's
        pairs_.extend(list_.size() + carried.pairs.size(), kernel_.traits);
        keys.reserve(carried.pairs.size());
        for (const CarriedPair& pair : carried.pairs) {
            pairs_.store(list_.size() + keys.size(), pair.history);
            keys.push_back(pair.key);
        }
        carried.pairs = {}; // after a checkpoint was read these are all contacts
    }
    const search::CandidateList::Missed missed =
        list_.rebuild(p, reach_factor_, bond_reach_, outer_share_, close_factor, share_, order, old_owned,
                      wrapped, live(), keys, ahead(), team_);
    if (all_bonds)
        set_shares();
    if (missed.bound > 0)
        throw Error(ExitCode::run_failed,
                    fmt::format("{} bonds were stretched beyond the candidate list at step {}: take "
                                "a smaller time.step",
                                missed.bound, step_));
    listed_.resize(p.owned);
    const auto [lower, upper] = search::bounds(
        p.owned, [&](std::size_t row) { return p.bodies[row].position.vec(); }, team_);
    listed_origin_ = p.owned == 0 ? Vec3{} : 0.5 * (lower + upper);
    listed_rounding_ = p.owned == 0 ? 0 : 0x1p-24 * norm(upper - lower);
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 x = p.bodies[row].position.vec() - listed_origin_;
            listed_[row] = {static_cast<float>(x.x), static_cast<float>(x.y), static_cast<float>(x.z)};
        }
    });
    strain_since_rebuild_ = {1, 1, 1};
    if (membrane_.any())
        membrane_.set_rows(p);
    walls_.rebuild(p, wall_skin_, order, membrane_);
    give_walls(carried.walls);
    wall_record_.merge(world_);
    wall_travel_ = wall_used_ = 0;
    ++rebuilds_;
    take_close_list();
    if (regroups) {
        settle_balances(-1);
        sleep_->wanted = false;
    }
    if (!world_.alone() && !first && !carried.restored) {
        Census dropped;
        for (const auto& [i, j] : missed.parted)
            dropped.add_pair(i, j, false);
        check_census(before, dropped);
    }
    if (carried.restored) {
        std::uint64_t found = 0;
        for (std::size_t k = 0; k < list_.size(); ++k)
            found += live()(k) && !(pairs_.state[k] & counted_elsewhere);
        if (world_.sum(found) != carried.expected)
            throw Error(
                ExitCode::input_invalid,
                fmt::format("{} of the checkpoint's {} contacts are not among the near pairs: it does not "
                            "belong to this model",
                            carried.expected - world_.sum(found), carried.expected));
    }
}

void Simulation::refresh() {
    adapt_skins(false);
    set_shares();
    // Whether the outer list lasts was asked with the old shares: who has become quicker has a larger one
    // now.
    if (any_rank(largest_displacement().outer > 1)) {
        rebuild(false);
        return;
    }
    list_.refresh(particles_, share_, live(), team_);
    take_close_list();
}

/// What depends on the close list and comes after it.
void Simulation::take_close_list() {
    pairs_.reorder(list_.previous(), kernel_.traits, team_);
    mark_pairs_counted_elsewhere();
    complete_rows_.resize(list_.size() / sweep_block + 2);
    for (std::size_t b = 0; b < complete_rows_.size(); ++b)
        complete_rows_[b] = list_.rows_before(b * sweep_block);
    find_late_rows();
    assign_slots();
    close_ghosts_.clear();
    std::vector<std::uint32_t> close_copies;
    if (particles_.ghosts() > 0) {
        std::vector<bool> close(particles_.ghosts(), false);
        for (const search::Candidate& c : list_.candidates())
            for (const std::uint32_t row : {c.i, c.j})
                if (row >= particles_.owned)
                    close[row - particles_.owned] = true;
        for (std::uint32_t g = 0; g < close.size(); ++g)
            if (close[g] && g >= particles_.halo)
                close_ghosts_.push_back(g);
            else if (close[g])
                close_copies.push_back(static_cast<std::uint32_t>(particles_.owned) + g);
    }
    if (!world_.alone())
        halo_.want(particles_, close_copies);
    if (sleep_)
        find_border();
    strain_since_refresh_ = {1, 1, 1};
    refreshed_.resize(particles_.owned);
    team_.for_range(particles_.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 moved = moved_against_others(row);
            refreshed_[row] = {static_cast<float>(moved.x), static_cast<float>(moved.y),
                               static_cast<float>(moved.z)};
        }
    });
    ++refreshes_;
}

} // namespace talus::engine
