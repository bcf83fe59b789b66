// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/soft_spheres.hpp"

#include "base/error.hpp"
#include "search/cell_grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::packing {

namespace {

/// Separation to the nearest periodic image in the unit cube. Adding and taking away 1.5 * 2^52 rounds to the
/// nearest integer without a branch or a call; exact, and odd in its argument, so that both ends of a pair
/// see opposite vectors bit for bit.
inline double nearest_image(double d) {
    constexpr double magic = 0x1.8p52;
    return d - ((d + magic) - magic);
}

} // namespace

SoftSpheres::SoftSpheres(std::span<const Vec3> position, std::span<const double> radius, ThreadTeam& team,
                         std::size_t mobile)
    : team_(team), mobile_(std::min(mobile, position.size())), spheres_(position.size()),
      force_(position.size()), velocity_(position.size()), built_at_(position.size()),
      stiffness_(position.size()), inverse_mass_(position.size(), 1.0),
      block_sums_((mobile_ + block - 1) / block), block_value_(block_sums_.size()),
      lists_(static_cast<std::size_t>(team.size())), list_end_(mobile_) {
    double sum = 0, smallest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < size(); ++i) {
        spheres_[i] = {position[i].x, position[i].y, position[i].z, radius[i]};
        sum += radius[i];
        largest_ = std::max(largest_, radius[i]);
        smallest = std::min(smallest, radius[i]);
    }
    mono_ = largest_ == smallest;
    mean_diameter_ = size() > 0 ? 2 * sum / static_cast<double>(size()) : 0;
    skin_unit_ = 0.16;
    if (!(largest_ < largest_radius))
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("radius: {} box lengths is too large, grains would touch one another through two "
                        "periodic images: use a radius below {} box lengths",
                        largest_, largest_radius));
}

double SoftSpheres::solid_volume_fraction() const {
    double sum = 0;
    for (const Sphere& s : spheres_)
        sum += s.r * s.r * s.r;
    return 4.0 / 3.0 * std::numbers::pi * sum;
}

void SoftSpheres::scale_radii(double factor) {
    for (Sphere& s : spheres_)
        s.r *= factor;
    // The list holds all pairs within ri + rj + skin: growing radii eat from the skin.
    grown_ += (factor - 1) * largest_;
    largest_ *= factor;
    mean_diameter_ *= factor;
}

void SoftSpheres::set_positions(std::span<const Vec3> position) {
    for (std::size_t i = 0; i < size(); ++i)
        spheres_[i] = {position[i].x, position[i].y, position[i].z, spheres_[i].r};
    moved_ = std::numeric_limits<double>::infinity();
}

std::vector<Vec3> SoftSpheres::positions() const {
    std::vector<Vec3> out(size());
    for (std::size_t i = 0; i < size(); ++i)
        out[i] = position(i);
    return out;
}

double SoftSpheres::pairs_per_particle() const {
    std::size_t entries = 0;
    for (const auto& list : lists_)
        entries += list.size();
    return 0.5 * static_cast<double>(entries) / static_cast<double>(std::max<std::size_t>(1, mobile_));
}

void SoftSpheres::rebuild_list() {
    // A skin that lasts some 40 passes costs least: wider while grains run, narrow while they creep.
    if (rebuilds_ > 0) {
        if (passes_since_rebuild_ < 20)
            skin_unit_ = std::min(0.3, skin_unit_ * 1.5);
        else if (passes_since_rebuild_ > 80)
            skin_unit_ = std::max(0.01, skin_unit_ / 1.5);
    }
    skin_ = skin_unit_ * mean_diameter_;
    ++rebuilds_;
    passes_since_rebuild_ = 0;
    moved_ = grown_ = 0;
    for (std::size_t i = 0; i < size(); ++i) {
        Sphere& s = spheres_[i];
        for (double* c : {&s.x, &s.y, &s.z}) {
            *c -= std::floor(*c);
            if (*c >= 1)
                *c = 0;
        }
        built_at_[i] = {s.x, s.y, s.z};
    }
    search::CellGrid grid({0, 0, 0}, {1, 1, 1}, 2 * largest_ + skin_, size());
    grid.sort(size(), [this](std::size_t i) { return built_at_[i]; });
    const auto cells = grid.cells();
    for (auto& list : lists_)
        list.clear();
    team_.for_range(
        mobile_,
        [&](std::size_t begin, std::size_t end, int thread) {
            auto& list = lists_[static_cast<std::size_t>(thread)];
            // Fewer than three cells along an edge: take each neighbouring cell once.
            const auto span_of = [](int c, int n, std::array<int, 3>& out) {
                int count = 0;
                for (int d = -1; d <= 1; ++d) {
                    const int cell = (c + d + n) % n;
                    if (std::find(out.begin(), out.begin() + count, cell) == out.begin() + count)
                        out[static_cast<std::size_t>(count++)] = cell;
                }
                return count;
            };
            for (std::size_t i = begin; i < end; ++i) {
                const Sphere& a = spheres_[i];
                const auto home = grid.coordinates(built_at_[i]);
                std::array<int, 3> xs{}, ys{}, zs{};
                const int nx = span_of(home[0], cells[0], xs), ny = span_of(home[1], cells[1], ys),
                          nz = span_of(home[2], cells[2], zs);
                for (int kz = 0; kz < nz; ++kz)
                    for (int ky = 0; ky < ny; ++ky)
                        for (int kx = 0; kx < nx; ++kx) {
                            const auto u = [](int k) { return static_cast<std::size_t>(k); };
                            for (const std::uint32_t j :
                                 grid.members(grid.index({xs[u(kx)], ys[u(ky)], zs[u(kz)]}))) {
                                const Sphere& b = spheres_[j];
                                const double dx = nearest_image(b.x - a.x), dy = nearest_image(b.y - a.y),
                                             dz = nearest_image(b.z - a.z), reach = a.r + b.r + skin_;
                                if (dx * dx + dy * dy + dz * dz < reach * reach && j != i)
                                    list.push_back(j);
                            }
                        }
                while (list.size() % partner_group != 0)
                    list.push_back(static_cast<std::uint32_t>(i));
                list_end_[i] = list.size();
            }
        },
        block);
}

/// body(begin, end, list, list_begin) for each block, where list[list_begin] is the first partner of `begin`.
template <class Body>
void SoftSpheres::for_blocks(Body&& body) {
    team_.for_range(
        mobile_,
        [&](std::size_t begin, std::size_t end, int thread) {
            const std::uint32_t* list = lists_[static_cast<std::size_t>(thread)].data();
            for (std::size_t first = begin; first < end; first += block)
                // The part's first particle starts its thread's list.
                body(first, std::min(end, first + block), list, first == begin ? 0 : list_end_[first - 1]);
        },
        block);
}

ContactSums SoftSpheres::compute_forces() {
    if (mobile_ == 0)
        return {};
    if (!list_holds())
        rebuild_list();
    ++passes_since_rebuild_;
    for_blocks([this](std::size_t begin, std::size_t end, const std::uint32_t* list, std::size_t k) {
        std::array<PartnerSum, block> partner_sums;
        sum_partners(spheres_.data(), begin, end, list, k, list_end_.data(), mono_, partner_sums.data());
        ContactSums s;
        double contacts = 0;
        for (std::size_t i = begin; i < end; ++i) {
            const PartnerSum& p = partner_sums[i - begin];
            const Vec3 net{p.fx, p.fy, p.fz};
            force_[i] = net;
            contacts += p.contacts;
            s.held += p.contacts > 0 ? 1 : 0;
            s.force += p.force;
            s.virial += p.virial;
            s.overlap += p.overlap;
            stiffness_[i] = p.stiffness;
            s.stiffness = std::max(s.stiffness, p.stiffness * inverse_mass_[i]);
            const double f2 = norm2(net);
            s.net_force2 += f2 * inverse_mass_[i];
            s.net_force += std::sqrt(f2);
            s.power += dot(net, velocity_[i]);
            s.velocity2 += norm2(velocity_[i]) / inverse_mass_[i];
        }
        s.contacts = static_cast<std::size_t>(contacts);
        block_sums_[begin / block] = s;
    });
    ContactSums total;
    for (const ContactSums& s : block_sums_) {
        total.contacts += s.contacts;
        total.held += s.held;
        total.force += s.force;
        total.virial += s.virial;
        total.overlap += s.overlap;
        total.net_force += s.net_force;
        total.net_force2 += s.net_force2;
        total.power += s.power;
        total.velocity2 += s.velocity2;
        total.stiffness = std::max(total.stiffness, s.stiffness);
    }
    total.contacts /= 2; // each pair was seen from both ends
    total.force /= 2;
    total.virial /= 2;
    total.overlap /= 2;
    return total;
}

void SoftSpheres::stop() {
    std::fill(velocity_.begin(), velocity_.end(), Vec3{});
}

void SoftSpheres::weigh(double least) {
    double sum = 0;
    std::size_t held = 0;
    for (std::size_t i = 0; i < mobile_; ++i) {
        sum += stiffness_[i];
        held += stiffness_[i] > 0 ? 1 : 0;
    }
    if (held == 0)
        return;
    const double mean = sum / static_cast<double>(held);
    for (std::size_t i = 0; i < mobile_; ++i)
        inverse_mass_[i] = mean / std::max(stiffness_[i], least * mean);
}

void SoftSpheres::advance(double dt, double keep, double steer) {
    for_blocks([=, this](std::size_t begin, std::size_t end, const std::uint32_t*, std::size_t) {
        double moved2 = 0;
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3 f = force_[i] * inverse_mass_[i];
            // A grain without contacts rests: left to fly in its cage it would knock on the others for ever.
            const Vec3 v = f == Vec3{} ? f : (velocity_[i] + f * dt) * keep + f * steer;
            velocity_[i] = v;
            Sphere& s = spheres_[i];
            s.x += dt * v.x;
            s.y += dt * v.y;
            s.z += dt * v.z;
            moved2 = std::max(moved2, norm2(Vec3{s.x, s.y, s.z} - built_at_[i]));
        }
        block_value_[begin / block] = moved2;
    });
    moved_ = std::sqrt(*std::max_element(block_value_.begin(), block_value_.end()));
}

void SoftSpheres::step_back_and_stop(double dt) {
    for_blocks([=, this](std::size_t begin, std::size_t end, const std::uint32_t*, std::size_t) {
        for (std::size_t i = begin; i < end; ++i) {
            Sphere& s = spheres_[i];
            s.x -= 0.5 * dt * velocity_[i].x;
            s.y -= 0.5 * dt * velocity_[i].y;
            s.z -= 0.5 * dt * velocity_[i].z;
            velocity_[i] = {};
        }
    });
}

} // namespace talus::packing
