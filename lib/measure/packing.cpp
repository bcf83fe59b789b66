// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/packing.hpp"

#include "base/error.hpp"
#include "contact/constants.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::measure {

namespace {

void require_valid(const PgBox& box) {
    const auto fail = [](const std::string& what) {
        throw Error(ExitCode::input_invalid, what + "; make the box anew");
    };
    if (!(box.length > 0) || !std::isfinite(box.length))
        fail(fmt::format("box length {} is not a positive length", box.length));
    if (box.size() == 0)
        fail("the box holds no grain");
    if (box.radius.size() != box.size())
        fail(fmt::format("{} positions but {} radii", box.size(), box.radius.size()));
    for (std::size_t i = 0; i < box.size(); ++i) {
        const Vec3& p = box.position[i];
        if (!is_finite(p))
            fail(fmt::format("grain {}: position is not finite", i));
        for (int k = 0; k < 3; ++k)
            if (p[k] < 0 || p[k] >= box.length)
                fail(fmt::format("grain {}: coordinate {} lies outside [0, {}) m", i, p[k], box.length));
        if (!(box.radius[i] > 0) || !std::isfinite(box.radius[i]))
            fail(fmt::format("grain {}: radius {} is not a positive length", i, box.radius[i]));
    }
}

Histogram over_mean(std::vector<double> values) {
    double sum = 0;
    for (double v : values)
        sum += v;
    for (double& v : values)
        v *= static_cast<double>(values.size()) / sum;
    return histogram(values, 0.1);
}

} // namespace

double solid_volume_fraction(const PgBox& box) {
    double cubes = 0;
    for (double r : box.radius)
        cubes += r * r * r;
    return 4.0 / 3 * std::numbers::pi * cubes / std::pow(box.length, 3);
}

std::vector<double> hertz_forces(const PgBox& box, std::span<const ContactVector> contacts,
                                 const Material& material) {
    const double modulus = contact::effective_youngs_modulus(material, material);
    std::vector<double> force;
    force.reserve(contacts.size());
    for (const ContactVector& c : contacts) {
        const double ri = box.radius[c.i], rj = box.radius[c.j];
        force.push_back(contact::hertz_stiffness(modulus, ri * rj / (ri + rj), c.overlap) * c.overlap);
    }
    return force;
}

Stress virial_stress(const PgBox& box, std::span<const ContactVector> contacts,
                     std::span<const double> force) {
    Stress out;
    const double volume = std::pow(box.length, 3);
    for (std::size_t c = 0; c < contacts.size(); ++c) {
        const double weight = force[c] * contacts[c].distance / volume;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                out.tensor[static_cast<std::size_t>(a)][static_cast<std::size_t>(b)] +=
                    weight * contacts[c].normal[a] * contacts[c].normal[b];
    }
    out.pressure = (out.tensor[0][0] + out.tensor[1][1] + out.tensor[2][2]) / 3;
    out.principal = eigenvalues(out.tensor);
    return out;
}

Balance force_balance(std::size_t particles, std::span<const ContactVector> contacts,
                      std::span<const double> force) {
    Balance out;
    if (contacts.empty())
        return out;
    std::vector<Vec3> net(particles);
    std::vector<std::uint8_t> touched(particles, 0);
    double sum = 0;
    for (std::size_t c = 0; c < contacts.size(); ++c) {
        net[contacts[c].i] -= force[c] * contacts[c].normal;
        net[contacts[c].j] += force[c] * contacts[c].normal;
        touched[contacts[c].i] = touched[contacts[c].j] = 1;
        sum += force[c];
    }
    out.mean_contact_force = sum / static_cast<double>(contacts.size());
    double total = 0, largest = 0, count = 0;
    for (std::size_t i = 0; i < particles; ++i) {
        const double f = norm(net[i]);
        total += f;
        largest = std::max(largest, f);
        count += touched[i];
    }
    if (out.mean_contact_force > 0) {
        out.mean_unbalanced_force = total / count / out.mean_contact_force;
        out.max_unbalanced_force = largest / out.mean_contact_force;
    }
    return out;
}

PackingMeasures measure_packing(const PgBox& box, const Material& material, ThreadTeam& team) {
    require_valid(box);
    PackingMeasures out;
    out.particle_count = box.size();
    out.box_length = box.length;
    out.solid_volume_fraction = solid_volume_fraction(box);
    double radii = 0;
    for (double r : box.radius)
        radii += r;
    out.mean_radius = radii / static_cast<double>(box.size());
    const auto [least, most] = std::minmax_element(box.radius.begin(), box.radius.end());
    out.min_radius = *least;
    out.max_radius = *most;

    const ContactTable table = find_contacts(box, team);
    out.contacts = compare_contacts(box, table, 1e-12 * out.max_radius);
    const std::vector<ContactVector> contacts = contact_vectors(box, table);
    out.contact_count = contacts.size();
    out.coordination = coordination(box.size(), contacts);
    double sum = 0, largest = 0;
    std::vector<double> overlap;
    for (const ContactVector& c : contacts) {
        overlap.push_back(c.overlap);
        sum += c.overlap;
        largest = std::max(largest, c.overlap);
    }
    if (!contacts.empty())
        out.mean_overlap_ratio = sum / static_cast<double>(contacts.size()) / out.mean_radius;
    out.max_overlap_ratio = largest / out.mean_radius;

    const std::vector<double> force = hertz_forces(box, contacts, material);
    out.stress = virial_stress(box, contacts, force);
    out.balance = force_balance(box.size(), contacts, force);
    out.overlap_over_mean = over_mean(std::move(overlap));
    out.force_over_mean = over_mean(force);
    out.overlaps = overlap_by_polar_angle(contacts);
    out.fabric = fabric(contacts);
    out.bond_order_q6 = bond_order_q6(contacts);
    out.radial = radial_distribution(box, 3.0, 0.02, team);
    out.crystal = crystal_check(out.radial);
    out.order = local_order(box, team);
    out.local_fraction = local_fraction(box);
    out.structure_factor = structure_factor(box, 10.0, team);
    out.seam = seam_check(box, contacts);
    return out;
}

} // namespace talus::measure
