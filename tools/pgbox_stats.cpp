// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/thread_team.hpp"
#include "cli/plot.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "io/pgbox_file.hpp"
#include "measure/packing.hpp"
#include "measure/pictures.hpp"
#include "measure/run_on.hpp"
#include "measure/tiling_pattern.hpp"
#include "tiling/family.hpp"
#include "tiling/variant_draw.hpp"

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

nlohmann::json report(const measure::Histogram& h, const char* name) {
    return {{name, h.centre}, {"density", h.density}, {"bin_width", h.bin_width}};
}

nlohmann::json report(const measure::SeamScore& s) {
    return {{"face", s.face},
            {"inside", s.inside},
            {"standard_error", s.standard_error},
            {"z_score", s.z_score},
            {"conspicuous", s.conspicuous},
            {"outlier",
             {{"place", s.outlier.place},
              {"value", s.outlier.value},
              {"z_score", s.outlier.z_score},
              {"conspicuous", s.outlier.conspicuous}}}};
}

nlohmann::json report(const measure::SeamCheck& s) {
    nlohmann::json out = {{"slab_width", s.slab_width}, {"uniform", s.uniform}};
    for (std::size_t a = 0; a < 3; ++a) {
        const std::string axis(1, "xyz"[a]);
        out[axis] = {{"solid_volume_fraction", report(s.axis[a].solid_volume_fraction)},
                     {"coordination_number", report(s.axis[a].coordination_number)},
                     {"mean_overlap_ratio", report(s.axis[a].mean_overlap_ratio)},
                     {"contacts_through_plane", report(s.axis[a].contacts_through)},
                     {"contacts_across_face", s.contacts_across[a]},
                     {"profile",
                      {{"solid_volume_fraction", s.profile[a].solid_volume_fraction},
                       {"coordination_number", s.profile[a].coordination_number},
                       {"mean_overlap_ratio", s.profile[a].mean_overlap_ratio},
                       {"contacts_through_plane", s.profile[a].contacts_through}}}};
    }
    return out;
}

nlohmann::json report(const measure::RunOn& r) {
    return {{"steps", r.steps},
            {"time_step", r.time_step},
            {"time", r.time},
            {"rms_displacement_ratio", r.rms_displacement_ratio},
            {"max_displacement_ratio", r.max_displacement_ratio},
            {"max_rattler_displacement_ratio", r.max_rattler_displacement_ratio},
            {"coordination_number_before", r.coordination_number_before},
            {"coordination_number_after", r.coordination_number_after},
            {"unbalanced_force_before", r.unbalanced_force_before},
            {"unbalanced_force_after", r.unbalanced_force_after},
            {"elastic_energy_before", r.elastic_energy_before},
            {"elastic_energy_after", r.elastic_energy_after},
            {"max_kinetic_ratio", r.max_kinetic_ratio},
            {"kinetic_ratio_after", r.kinetic_ratio_after},
            {"tangential_springs_restored", r.springs_restored},
            {"quasi_static", r.quasi_static}};
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
    out["overlap_distribution"] = report(m.overlap_over_mean, "overlap_over_mean");
    out["force_distribution"] = report(m.force_over_mean, "force_over_mean");
    out["local_solid_fraction"] = {{"mean", m.local_fraction.mean},
                                   {"standard_deviation", m.local_fraction.standard_deviation},
                                   {"min", m.local_fraction.min},
                                   {"max", m.local_fraction.max},
                                   {"grains_without_cell", m.local_fraction.without_cell},
                                   {"volume_error", m.local_fraction.volume_error},
                                   {"distribution", report(m.local_fraction.distribution, "fraction")}};
    out["local_order"] = {{"mean_q6", m.order.mean_q6},
                          {"crystal_fraction", m.order.crystal_fraction},
                          {"distribution", report(m.order.distribution, "q6")}};
    out["structure_factor"] = {{"k_times_diameter", m.structure_factor.k_times_diameter},
                               {"s", m.structure_factor.s},
                               {"s_by_volume", m.structure_factor.s_by_volume},
                               {"vectors", m.structure_factor.vectors},
                               {"small_k", m.structure_factor.small_k},
                               {"small_k_error", m.structure_factor.small_k_error}};
    out["seam"] = report(m.seam);
    return out;
}

nlohmann::json report(const measure::TilingPattern& p) {
    nlohmann::json out = {{"variants", p.variants},
                          {"tiles_per_edge", p.tiles_per_edge},
                          {"voxels_per_edge", p.voxels_per_edge},
                          {"skin_fraction", p.skin_fraction},
                          {"skin_variance_fraction", p.skin_variance_fraction},
                          {"variant_correlation", p.variant_correlation},
                          {"predicted", p.predicted},
                          {"shifts", nlohmann::json::array()}};
    for (const auto& shift : p.shifts)
        out["shifts"].push_back({{"tiles", shift.tiles},
                                 {"autocorrelation", shift.autocorrelation},
                                 {"same_variant", shift.same_variant},
                                 {"expected_as_drawn", shift.expected_as_drawn}});
    return out;
}

/// Of 8 x 8 x 8 tiles, drawn as tile-trim draws them.
nlohmann::json tiling_pattern(const std::vector<io::PgBoxFile>& files, std::uint64_t seed, ThreadTeam& team) {
    std::vector<PgBox> boxes;
    for (const io::PgBoxFile& file : files)
        boxes.push_back(file.box);
    return report(measure::tiling_pattern(
        boxes, tiling::skin_thickness(files.front()), 8,
        [&](const std::array<std::int32_t, 3>& tile) {
            return tiling::draw_variant(tile, seed, boxes.size());
        },
        team));
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool(
        {.name = "pgbox-stats",
         .summary =
             "Judges a periodic granular box: density, contacts, fabric, balance, structure, periodicity",
         .version = TALUS_VERSION,
         .min_inputs = 1,
         .max_inputs = 255,
         .needs_output = false,
         .input_help =
             "periodic granular box (*.pgbox.h5); of several, variants of one, the first is judged, and "
             "how a tiling of all repeats itself",
         .epilog =
             "Contacts are found anew from the positions; the stored ones are only compared with them.\n"
             "local_solid_fraction: of each grain's cell of the periodic weighted Voronoi diagram.\n"
             "local_order: q6 over neighbours within 1.35 diameters, averaged with theirs (fcc 0.575, hcp "
             "0.485, disorder below 0.35); crystal_fraction: grains with 8 or more solid-like bonds.\n"
             "structure_factor: S(k) at the box's wave vectors in shells, vectors: how many of them; "
             "small_k: "
             "the mean below k d = 1.\n"
             "seam, for x, y and z: slabs a diameter wide at the faces against those inside, in standard "
             "errors; "
             "outlier: the slab that differs most from the others (earlier seams lie inside); uniform: "
             "nothing "
             "of this that chance brings less often than once in 10,000.\n"
             "run_on (with --run-on 1000): drift over the grain's radius, energies and balance; "
             "quasi_static: "
             "no grain moves 0.01, kinetic energy below 1e-4 of elastic, unbalanced force below 0.001.\n"
             "tiling_pattern, of several boxes drawn per tile as tile-trim draws them (--seed), 8 x 8 x 8 "
             "tiles: "
             "autocorrelation of the density at shifts by whole tiles, 1 for a single box; predicted: "
             "f + (1 - f) / variants, f the volume fraction of the skin they share; expected_as_drawn: the "
             "same with the pairs of equal tiles that were drawn.",
         .libraries = {},
         .result_in_output = true,
         .simd_target = ""});
    std::optional<double> youngs_modulus, poissons_ratio;
    tool.settings().optional_number("youngs_modulus", youngs_modulus, cli::Unit::pressure,
                                    "for forces and pressure; auto: as stored with the box, else 1e8",
                                    cli::positive);
    tool.settings().optional_number("poissons_ratio", poissons_ratio, cli::Unit::none,
                                    "auto: as stored with the box, else 0.2", {-1, 0.5, true, false});
    std::int64_t run_on_steps = 0;
    tool.settings().integer("run_on", run_on_steps,
                            "steps to run on without gravity and without damping beyond the contact law; "
                            "1000 is the check of rest",
                            0);
    std::string plot;
    tool.app().add_option(
        "--plot", plot,
        "picture of overlaps, g(r), S(k), local fraction, slabs and forces: FILE.svg, .png or .pdf");
    return tool.run(argc, argv, [&] {
        if (!plot.empty()) {
            cli::check_plot_path(plot);
            cli::check_output(plot, tool.common().overwrite);
        }
        const std::string& path = tool.common().inputs.front();
        std::vector<io::PgBoxFile> files;
        for (const std::string& input : tool.common().inputs)
            files.push_back(io::read_pgbox(input));
        tiling::require_one_family(files, tool.common().inputs);
        const io::PgBoxFile& file = files.front();
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
        auto result = report(measures, material, number_of(file.attributes, "friction"),
                             number_of(file.attributes, "unbalanced_force"));
        if (files.size() > 1)
            result["tiling_pattern"] = tiling_pattern(files, tool.common().seed, team);
        if (!file.grading.diameter.empty())
            result["grading"] = {{"diameter", file.grading.diameter},
                                 {"fraction_finer", file.grading.fraction_finer}};
        if (run_on_steps > 0) {
            material.friction = number_of(file.attributes, "friction").value_or(0);
            material.restitution = number_of(file.attributes, "restitution").value_or(material.restitution);
            result["run_on"] = report(
                measure::run_on(file.box, material, measures.coordination.rattler, run_on_steps, team));
        }
        tool.result(result);
    });
}
