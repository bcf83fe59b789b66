// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/thread_team.hpp"
#include "cli/plot.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "io/pgbox_file.hpp"
#include "measure/packing.hpp"
#include "measure/pictures.hpp"

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

using namespace talus;

namespace {

std::optional<double> number_of(const io::Attributes& attributes, const std::string& key) {
    const auto at = attributes.find(key);
    if (at == attributes.end())
        return std::nullopt;
    if (const auto* real = std::get_if<double>(&at->second))
        return *real;
    if (const auto* whole = std::get_if<std::int64_t>(&at->second))
        return static_cast<double>(*whole);
    return std::nullopt;
}

nlohmann::json report(const measure::PackingMeasures& m, const Material& material,
                      std::optional<double> friction, std::optional<double> stored_unbalanced) {
    // Tangential forces are not stored in a box: with friction only its maker knows the balance.
    const bool from_maker = friction.value_or(0) > 0 && stored_unbalanced;
    nlohmann::json out;
    out["schema"] = "pgbox-stats";
    out["version"] = 1;
    out["particle_count"] = m.particle_count;
    out["contact_count"] = m.contact_count;
    out["box_length"] = m.box_length;
    out["mean_radius"] = m.mean_radius;
    out["min_radius"] = m.min_radius;
    out["max_radius"] = m.max_radius;
    out["solid_volume_fraction"] = m.solid_volume_fraction;
    out["coordination_number"] = m.coordination.mean;
    out["coordination_number_no_rattlers"] = m.coordination.mean_no_rattlers;
    out["rattler_fraction"] = m.coordination.rattler_fraction;
    out["mean_overlap_ratio"] = m.mean_overlap_ratio;
    out["max_overlap_ratio"] = m.max_overlap_ratio;
    out["youngs_modulus"] = material.youngs_modulus;
    out["poissons_ratio"] = material.poissons_ratio;
    out["pressure"] = m.stress.pressure;
    out["stress"] = m.stress.tensor;
    out["unbalanced_force"] = from_maker ? *stored_unbalanced : m.balance.mean_unbalanced_force;
    out["unbalanced_force_definition"] =
        from_maker ? "as stored by the program that made the box, all forces"
                   : "mean net normal force on grains in contact over mean contact normal force";
    out["unbalanced_normal_force"] = m.balance.mean_unbalanced_force;
    out["max_unbalanced_normal_force"] = m.balance.max_unbalanced_force;
    out["mean_contact_force"] = m.balance.mean_contact_force;
    out["relative_standard_deviation"] = m.overlaps.relative_standard_deviation;
    out["counting_noise"] = m.overlaps.counting_noise;
    out["overlap_variation"] = m.overlaps.overlap_variation;
    out["kurtosis"] = m.overlaps.kurtosis;
    out["overlap_by_polar_angle"] = m.overlaps.value;
    out["fabric_tensor"] = m.fabric.tensor;
    out["fabric_eigenvalues"] = m.fabric.eigenvalue;
    out["fabric_anisotropy"] = m.fabric.anisotropy;
    out["fabric_vertical_excess"] = m.fabric.vertical_excess;
    out["bond_order_q6"] = m.bond_order_q6;
    out["crystal_peak_ratio"] = m.crystal.peak_ratio;
    out["crystalline"] = m.crystal.crystalline;
    out["contacts_across_faces"] = m.contacts.across_faces;
    out["contacts_stored"] = m.contacts.stored;
    out["contacts_missing"] = m.contacts.missing;
    out["contacts_extra"] = m.contacts.extra;
    out["largest_overlap_difference"] = m.contacts.largest_overlap_difference;
    out["periodic"] = m.contacts.periodic();
    out["radial_distribution"] = {{"r_over_diameter", m.radial.r_over_diameter}, {"g", m.radial.g}};
    return out;
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool(
        {.name = "pgbox-stats",
         .summary =
             "Judges a periodic granular box: density, contacts, fabric, balance, structure, periodicity",
         .version = TALUS_VERSION,
         .min_inputs = 1,
         .max_inputs = 1,
         .needs_output = false,
         .input_help = "periodic granular box (*.pgbox.h5)",
         .epilog = "Contacts are found anew from the positions; the stored ones are only compared with them.",
         .libraries = {},
         .result_in_output = true,
         .simd_target = ""});
    std::optional<double> youngs_modulus, poissons_ratio;
    tool.settings().optional_number("youngs_modulus", youngs_modulus, cli::Unit::pressure,
                                    "for forces and pressure; auto: as stored with the box, else 1e8",
                                    cli::positive);
    tool.settings().optional_number("poissons_ratio", poissons_ratio, cli::Unit::none,
                                    "auto: as stored with the box, else 0.2", {-1, 0.5, true, false});
    std::string plot;
    tool.app().add_option("--plot", plot, "picture of overlap distribution and g(r): FILE.svg, .png or .pdf");
    return tool.run(argc, argv, [&] {
        if (!plot.empty()) {
            cli::check_plot_path(plot);
            cli::check_output(plot, tool.common().overwrite);
        }
        const std::string& path = tool.common().inputs.front();
        const io::PgBoxFile file = io::read_pgbox(path);
        if (tool.common().dry_run) {
            tool.result({{"particle_count", file.box.size()}, {"contact_count", file.box.contacts.size()}});
            return;
        }
        Material material;
        material.youngs_modulus = youngs_modulus.value_or(
            number_of(file.attributes, "youngs_modulus").value_or(material.youngs_modulus));
        material.poissons_ratio = poissons_ratio.value_or(
            number_of(file.attributes, "poissons_ratio").value_or(material.poissons_ratio));
        ThreadTeam team(tool.common().threads);
        const measure::PackingMeasures measures = measure::measure_packing(file.box, material, team);
        if (!measures.contacts.periodic())
            tool.warn(fmt::format(
                "{}: /connectivity/contacts: {} contacts missing, {} too many against the positions; "
                "make the box anew",
                path, measures.contacts.missing, measures.contacts.extra));
        if (!plot.empty()) {
            const auto picture = measure::packing_picture(
                measures, fmt::format("{}: {} grains, solid volume fraction {:.4f}, Z = {:.3f}", path,
                                      measures.particle_count, measures.solid_volume_fraction,
                                      measures.coordination.mean));
            cli::gnuplot(picture.script, plot, picture.width, picture.height);
        }
        tool.result(report(measures, material, number_of(file.attributes, "friction"),
                           number_of(file.attributes, "unbalanced_force")));
    });
}
