// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/wall_record.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

namespace talus::engine {

namespace {

/// Numbers of a peak in a checkpoint: force, its vector, step, first step.
constexpr std::size_t peak_size = 6;

} // namespace

std::array<Vec3, 2> patch_axes(const Vec3& normal) {
    Vec3 u = Vec3{1, 0, 0} - normal.x * normal;
    if (norm(u) < 1e-6)
        u = Vec3{0, 1, 0} - normal.y * normal;
    u = u / norm(u);
    return {u, cross(normal, u)};
}

WallRecord::WallRecord(const WallContacts& contacts, double scale) : walls_(contacts.count()), zero_(scale) {
    std::size_t patches = 0;
    for (std::size_t w = 0; w < walls_.size(); ++w) {
        Range& range = walls_[w];
        range.first = patches;
        if (const MeshWall* mesh = contacts.mesh(w)) {
            range.count = mesh->triangles();
        } else if (const auto& grid = contacts.wall(w).patches) {
            range.across =
                static_cast<std::size_t>(std::ceil(2 * grid->half_width / grid->cell * (1 - 1e-12)));
            range.count = range.across * range.across;
        }
        patches += range.count;
    }
    now_.assign(patches, zero_);
    clear();
}

void WallRecord::clear() {
    sums_.assign(3 * walls_.size() + 4 * now_.size(), zero_);
    peaks_.assign(walls_.size() + now_.size(), {});
    parts_.clear();
}

std::optional<std::size_t> WallRecord::patch_of(const WallContacts& contacts, const WallContacts::Entry& e,
                                                const ParticleColumns& p, const Box& box) const {
    const Range& range = walls_[e.wall];
    if (range.count == 0)
        return std::nullopt;
    if (e.on_mesh != WallContacts::none)
        return range.first + contacts.triangle(e);
    const Wall& wall = contacts.wall(e.wall);
    const auto axes = patch_axes(wall.normal);
    const Vec3 from = box.wrap(p.bodies[e.row].position.vec()) - wall.point;
    std::array<std::size_t, 2> cell{};
    for (std::size_t k = 0; k < 2; ++k) {
        const double at = std::floor((dot(from, axes[k]) + wall.patches->half_width) / wall.patches->cell);
        if (!(at >= 0 && at < static_cast<double>(range.across)))
            return std::nullopt;
        cell[k] = static_cast<std::size_t>(at);
    }
    return range.first + cell[1] * range.across + cell[0];
}

void WallRecord::compare(std::uint64_t what, std::int64_t step, const std::array<ExactSum, 3>& force) {
    Peak& peak = peaks_[what];
    const Vec3 f{force[0].value(), force[1].value(), force[2].value()};
    const double size = what < walls_.size() ? norm(f) : f.x;
    if (size != 0 && peak.first < 0)
        peak.first = step;
    if (size > peak.force)
        peak = {size, f, step, peak.first};
}

void WallRecord::add(const WallContacts& contacts, const ParticleColumns& p, const Box& box,
                     std::int64_t step, bool first, ThreadTeam& team, const parallel::Communicator& world) {
    if (first)
        clear();
    const std::span<const WallContacts::Entry> entries = contacts.entries();
    if (entries.empty())
        return;
    const double weight = first ? 0.5 : 1;
    const std::size_t walls = walls_.size();
    // Of each thread: the walls' forces, and which entries push on a patch.
    struct Share {
        std::vector<ExactSum> force;
        std::vector<std::pair<std::size_t, std::size_t>> on_patch; ///< patch, entry
    };
    std::vector<Share> shares(static_cast<std::size_t>(team.size()));
    team.for_range(entries.size(), [&](std::size_t begin, std::size_t end, int thread) {
        Share& share = shares[static_cast<std::size_t>(thread)];
        share.force.assign(3 * walls, zero_);
        for (std::size_t k = begin; k < end; ++k) {
            const WallContacts::Entry& e = entries[k];
            if (e.force == Vec3{})
                continue;
            for (int d = 0; d < 3; ++d)
                share.force[3 * e.wall + static_cast<std::size_t>(d)].add(-e.force[d]);
            if (walls_[e.wall].count == 0)
                continue;
            if (const auto patch = patch_of(contacts, e, p, box))
                share.on_patch.emplace_back(*patch, k);
        }
    });
    std::vector<ExactSum> force(3 * walls, zero_);
    for (const Share& share : shares) {
        for (std::size_t k = 0; k < share.force.size(); ++k)
            force[k].add(share.force[k]);
        for (const auto& [patch, entry] : share.on_patch) {
            const WallContacts::Entry& e = entries[entry];
            const double normal = dot(e.force, contacts.normal(e));
            ExactSum* const sums = patch_sums(patch);
            for (int d = 0; d < 3; ++d)
                sums[d].add(-weight * e.force[d]);
            sums[3].add(weight * normal);
            if (now_[patch].high_bits() == 0 && now_[patch].low_bits() == 0)
                touched_.push_back(patch);
            now_[patch].add(normal);
        }
    }
    // Weights are powers of two, but a half may lose a quantum: the same one each time.
    const auto take = [&](std::uint64_t what, const std::array<ExactSum, 3>& sums) {
        if (world.alone())
            compare(what, step, sums);
        else
            parts_.push_back({what,
                              step,
                              {sums[0].high_bits(), sums[0].low_bits(), sums[1].high_bits(),
                               sums[1].low_bits(), sums[2].high_bits(), sums[2].low_bits()}});
    };
    for (const WallContacts::Entry& e : entries) // rare enough: the first step only
        if (first)
            for (int d = 0; d < 3; ++d)
                wall_sums(e.wall)[d].add(-0.5 * e.force[d]);
    for (std::size_t w = 0; w < walls; ++w) {
        const std::array<ExactSum, 3> sums{force[3 * w], force[3 * w + 1], force[3 * w + 2]};
        if (!first)
            for (std::size_t d = 0; d < 3; ++d)
                wall_sums(w)[d].add(sums[d]);
        take(w, sums);
    }
    for (const std::size_t patch : touched_) {
        take(walls + patch, {now_[patch], zero_, zero_});
        now_[patch].reset();
    }
    touched_.clear();
}

void WallRecord::merge(const parallel::Communicator& world) {
    if (world.alone())
        return;
    std::vector<std::vector<Part>> to(static_cast<std::size_t>(world.size()));
    to[0] = std::move(parts_);
    parts_.clear();
    std::vector<Part> all = world.exchange(to);
    std::sort(all.begin(), all.end(), [](const Part& a, const Part& b) {
        return std::tie(a.what, a.step) < std::tie(b.what, b.step);
    });
    for (std::size_t k = 0; k < all.size();) {
        const std::uint64_t what = all[k].what;
        const std::int64_t step = all[k].step;
        std::array<ExactSum, 3> sums{zero_, zero_, zero_};
        for (; k < all.size() && all[k].what == what && all[k].step == step; ++k)
            for (std::size_t d = 0; d < 3; ++d) {
                ExactSum part = zero_;
                part.set_bits(all[k].bits[2 * d], all[k].bits[2 * d + 1]);
                sums[d].add(part);
            }
        compare(what, step, sums);
    }
}

std::vector<WallReport> WallRecord::report(const WallContacts& contacts, const ParticleColumns& p,
                                           const Box& box, double step, std::int64_t steps,
                                           const parallel::Communicator& world) const {
    WallRecord total = *this; // of which the present forces count half only
    for (const WallContacts::Entry& e : contacts.entries()) {
        for (int d = 0; d < 3; ++d)
            total.wall_sums(e.wall)[d].add(0.5 * e.force[d]);
        if (e.force == Vec3{})
            continue;
        if (const auto patch = patch_of(contacts, e, p, box)) {
            for (int d = 0; d < 3; ++d)
                total.patch_sums(*patch)[d].add(0.5 * e.force[d]);
            total.patch_sums(*patch)[3].add(-0.5 * dot(e.force, contacts.normal(e)));
        }
    }
    world.sum(total.sums_);
    world.broadcast(total.peaks_.data(), total.peaks_.size() * sizeof(Peak));
    const auto impulse = [&](const ExactSum* sums) {
        return step * Vec3{sums[0].value(), sums[1].value(), sums[2].value()};
    };
    const double time = static_cast<double>(steps) * step;
    std::vector<WallReport> reports;
    for (std::size_t w = 0; w < walls_.size(); ++w) {
        const Peak& peak = total.peaks_[w];
        WallReport& report = reports.emplace_back();
        report.impulse = impulse(total.wall_sums(w));
        report.peak_force = peak.force;
        report.peak_force_vector = peak.vector;
        report.peak_time = static_cast<double>(peak.step) * step;
        if (peak.first >= 0)
            report.first_time = static_cast<double>(peak.first) * step;
        const Range& range = walls_[w];
        if (range.count == 0)
            continue;
        WallReport::Patches& patches = report.patches.emplace();
        const Wall& wall = contacts.wall(w);
        if (const MeshWall* mesh = contacts.mesh(w)) {
            for (const Vec3& point : wall.mesh->points)
                patches.points.push_back(point + (wall.point - mesh->centre()));
            for (std::size_t k = 0; k < range.count; ++k) {
                patches.corners.insert(patches.corners.end(), wall.mesh->faces[k].begin(),
                                       wall.mesh->faces[k].end());
                patches.area.push_back(mesh->face(k).area);
            }
        } else {
            const auto axes = patch_axes(wall.normal);
            const std::size_t row = range.across + 1;
            const double cell = wall.patches->cell, half = wall.patches->half_width;
            patches.sides = 4;
            for (std::size_t j = 0; j < row; ++j)
                for (std::size_t i = 0; i < row; ++i)
                    patches.points.push_back(wall.point + (static_cast<double>(i) * cell - half) * axes[0] +
                                             (static_cast<double>(j) * cell - half) * axes[1]);
            for (std::size_t k = 0; k < range.count; ++k) {
                const std::size_t corner = k / range.across * row + k % range.across;
                for (const std::size_t c : {corner, corner + 1, corner + row + 1, corner + row})
                    patches.corners.push_back(static_cast<std::uint32_t>(c));
            }
            patches.area.assign(range.count, cell * cell);
        }
        for (std::size_t k = 0; k < range.count; ++k) {
            const ExactSum* const sums = total.patch_sums(range.first + k);
            const Peak& of_patch = total.peaks_[walls_.size() + range.first + k];
            const double normal = step * sums[3].value(), area = patches.area[k];
            patches.impulse.push_back(impulse(sums));
            patches.normal_impulse.push_back(normal);
            patches.mean_pressure.push_back(time > 0 ? normal / (area * time) : 0);
            patches.peak_pressure.push_back(of_patch.force / area);
            patches.peak_time.push_back(static_cast<double>(of_patch.step) * step);
        }
    }
    return reports;
}

WallRecord::State WallRecord::save(const WallContacts& contacts, const parallel::Communicator& world) const {
    WallRecord total = *this;
    world.sum(total.sums_);
    world.broadcast(total.peaks_.data(), total.peaks_.size() * sizeof(Peak));
    State state;
    for (std::size_t w = 0; w < walls_.size(); ++w)
        state.peaks.push_back(contacts.mesh(w) ? contacts.mesh(w)->hash() : 0);
    for (const ExactSum& sum : total.sums_) {
        state.sums.push_back(sum.high_bits());
        state.sums.push_back(sum.low_bits());
    }
    for (const Peak& peak : total.peaks_)
        state.peaks.insert(state.peaks.end(),
                           {peak.force, peak.vector.x, peak.vector.y, peak.vector.z,
                            static_cast<double>(peak.step), static_cast<double>(peak.first)});
    return state;
}

void WallRecord::restore(const State& state, const WallContacts& contacts,
                         const parallel::Communicator& world) {
    bool same = state.sums.size() == 2 * sums_.size() &&
                state.peaks.size() == walls_.size() + peak_size * peaks_.size();
    for (std::size_t w = 0; w < walls_.size() && same; ++w)
        same = state.peaks[w] == (contacts.mesh(w) ? contacts.mesh(w)->hash() : 0);
    if (!same)
        throw Error(ExitCode::input_invalid,
                    "the checkpoint was made with other walls or meshes: resume with the mesh files it was "
                    "made with");
    clear();
    if (world.rank() != 0) // the first rank has it all
        return;
    for (std::size_t k = 0; k < sums_.size(); ++k)
        sums_[k].set_bits(state.sums[2 * k], state.sums[2 * k + 1]);
    const double* from = state.peaks.data() + walls_.size();
    for (Peak& peak : peaks_) {
        peak = {from[0],
                {from[1], from[2], from[3]},
                static_cast<std::int64_t>(from[4]),
                static_cast<std::int64_t>(from[5])};
        from += peak_size;
    }
}

} // namespace talus::engine
