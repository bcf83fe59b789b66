// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/scene_settings.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::dem_run {

using cli::Unit;

namespace {
constexpr std::size_t most_materials = 255; ///< besides `material`: the numbers in a model are bytes
}

SceneSettings::SceneSettings(cli::Settings& s) : settings_(s) {
    s.vec3("gravity", scene_.gravity, Unit::acceleration, "acceleration of gravity");
    Material& m = scene_.material;
    s.number("material.density", m.density, Unit::density, "density of the grains", cli::positive);
    s.number("material.youngs_modulus", m.youngs_modulus, Unit::pressure, "Young's modulus of the grains",
             cli::positive);
    s.number("material.poissons_ratio", m.poissons_ratio, Unit::none, "Poisson's ratio of the grains",
             {0, 0.5});
    s.number("material.restitution", m.restitution, Unit::none, "nominal coefficient of restitution",
             {0, 1, true, false});
    s.number("material.friction", m.friction, Unit::none, "Coulomb friction between grains",
             cli::not_negative);
    add_materials();

    s.optional_section("bond", "bonds between grains; absent: none, and nothing spent on them");
    s.number("bond.bond_pressure", bond_.bond_pressure, Unit::pressure, "tensile strength P_b",
             cli::not_negative);
    s.number("bond.bond_friction", bond_.bond_friction, Unit::none, "shear strength factor mu_b",
             cli::not_negative);
    s.number("bond.bond_initiation_factor", bond_.bond_initiation_factor, Unit::none,
             "pairs nearer than chi (ri + rj) are bonded at the start", {1, 2});
    s.flag("stress_free_start", scene_.stress_free_start,
           "all forces begin at zero: overlap offsets are set");

    s.choice(
        "contact.law", law_, {"hertz-mindlin", "linear"},
        "contact law; linear: springs of constant stiffness, dashpots proportional to the effective mass");
    s.number("contact.normal_stiffness", linear_.normal_stiffness, Unit::stiffness, "of the linear law",
             cli::not_negative);
    s.number("contact.tangential_stiffness", linear_.tangential_stiffness, Unit::stiffness,
             "of the linear law", cli::not_negative);
    s.number("contact.normal_damping", linear_.normal_damping, Unit::frequency,
             "of the linear law, per effective mass", cli::not_negative);
    s.number("contact.tangential_damping", linear_.tangential_damping, Unit::frequency,
             "of the linear law, per effective mass", cli::not_negative);
    s.choice("contact.separation", separation_, {"tension", "no-tension"},
             "normal force of separating unbonded pairs");
    s.choice("contact.damping", damping_, {"paper", "exact"}, "damping number from the restitution");
    s.choice("contact.lever_arm", lever_arm_, {"contact-point", "radius"},
             "lever arms of contact forces: to the contact point, or the radii as the paper prints");

    s.optional_section("box", "the domain; absent: the model's");
    s.vec3("box.lower", box_.lower, Unit::length, "lower corner");
    s.vec3("box.upper", box_.upper, Unit::length, "upper corner");
    s.flags3("box.periodic", box_.periodic, "periodic directions");
    add_walls();
    add_monitors();

    s.optional_number("time.end", end_, Unit::time, "end of the run, where there are no stages",
                      cli::positive);
    s.optional_number("time.step", scene_.step, Unit::time,
                      "time step, kept exactly; auto: from step_fraction", cli::positive);
    s.number("time.step_fraction", scene_.step_fraction, Unit::none, "of the smallest grain's Rayleigh time",
             cli::positive);
    s.flag("time.allow_unstable", scene_.allow_unstable, "accept a step above the stable limit");
    s.number("damping.viscous", scene_.viscous_damping, Unit::frequency, "force -c m v; for settling",
             cli::not_negative);
    s.number("sleep.tolerance", scene_.sleep_tolerance, Unit::none,
             "of the weight: regions sleep whose forces are balanced to this, and wake where forces changed "
             "by five times "
             "as much; 0: nothing sleeps",
             {0, 1});
    s.flag("sleep.audit", scene_.sleep_audit,
           "now and then wakes a hundredth of the sleepers and reports how wrong they were");
    s.choice("precision", precision_, {"double", "mixed"}, "arithmetic of the contact loop");
    s.number("skin", scene_.skin, Unit::none,
             "reach of the candidate list beyond touch, of the largest radius", {0, 2, true, false});
    s.choice("kernel", kernel_, {"specialised", "reference"}, "pair loop; reference: the slow yardstick");
    s.number("rest.unbalanced_force", scene_.rest_unbalanced, Unit::none,
             "at rest below this mean net force over mean contact force ...", cli::positive);
    s.number("rest.speed", scene_.rest_speed, Unit::none, "... and below this rms speed over sqrt(g r)",
             cli::positive);

    s.number("output.frame_interval", scene_.frame_interval, Unit::time,
             "between frames; 0: first and last only", cli::not_negative);
    s.number("output.series_interval", scene_.series_interval, Unit::time,
             "between rows of the series; 0: with every frame", cli::not_negative);
    s.strings("output.fields", fields, "of position, velocity, angular_velocity, force");
    s.flag("output.float64", float64, "frames in double precision");
    add_output();
    add_stages();
    add_triggers();
    add_triaxial();
    s.check([this] { check(); });
}

void SceneSettings::add_output() {
    cli::Settings& s = settings_;
    s.flag("output.changed_only", changed_only,
           "frames between the first of a stage and the last one hold only grains that moved");
    s.optional_number("output.change_tolerance", change_tolerance, Unit::length,
                      "with changed_only: a grain has moved that is further than this from where it was last "
                      "written; auto: 0.01 of the smallest radius",
                      cli::not_negative);
    s.flag("output.surface_labels", surface_labels,
           "write each grain's initial depth below the surface, and whether it lay at the surface");
    s.optional_number(
        "output.travel_interval", travel_interval_, Unit::time,
        "add up each grain's travel distance (Eq. 25) at this interval, frames or not; auto: do "
        "not",
        cli::positive);
    s.optional_number("output.travel_interval_fine", travel_interval_fine_, Unit::time,
                      "the same at a second interval, into the field travel_distance_fine", cli::positive);
    s.text("output.travel_from", travel_from,
           "stage from whose start on travel counts; empty: the first that releases, or the first");
}

/// Registers the keys of a region below `key`.
void SceneSettings::add_area(cli::Settings& e, const std::string& key, AreaText& area, Vec3& lower,
                             Vec3& upper) {
    e.text(key + ".outline", area.outline, "file of polygons (GeoJSON and others)");
    e.vec3(key + ".lower", lower, Unit::length, "lower corner of a box, in map coordinates");
    e.vec3(key + ".upper", upper, Unit::length, "upper corner of a box, in map coordinates");
    e.check([&e, key, &area, &lower, &upper] {
        if (e.given(key + ".lower"))
            area.lower = lower;
        if (e.given(key + ".upper"))
            area.upper = upper;
        for (int k = 0; k < 3; ++k)
            if (area.lower && area.upper && !(upper[k] > lower[k])) {
                e.reject(key + ".upper", "found a corner not above lower, expected upper > lower");
                return;
            }
    });
}

void SceneSettings::add_triggers() {
    cli::Settings& s = settings_;
    s.optional_section("shaking", "ground shaking, computed in the frame of the ground");
    s.text("shaking.file", accelerogram,
           "accelerogram: CSV with the columns time and ax, ay, az; units in the header, else s and m/s2");
    s.text("shaking.stage", shaking_onset_.stage,
           "stage with whose start the record's clock starts; empty: "
           "the run's");
    s.number("shaking.start", shaking_onset_.delay, Unit::time, "by which the record's clock starts later",
             cli::not_negative);
    s.number("shaking.scale", accelerogram_scale, Unit::none, "factor on all accelerations");
    s.objects(
        "strength_reduction",
        [this](std::size_t index, cli::Settings& e) {
            while (reductions_.size() <= index)
                reductions_.push_back(std::make_unique<ReductionText>());
            ReductionText& t = *reductions_[index];
            e.numbers("times", t.times, Unit::time, "at which the factors hold; linear in between");
            e.numbers("factors", t.factors, Unit::none, "on the strength, 0 to 1");
            e.strings("of", t.of, "what weakens: bond, friction, or both");
            e.text("stage", t.reduction.onset.stage,
                   "stage with whose start these times start; empty: the run's");
            e.number("start", t.reduction.onset.delay, Unit::time, "by which they start later",
                     cli::not_negative);
            add_area(e, "region", t.area, t.lower, t.upper);
            e.check([&e, &t] {
                if (t.times.empty() || t.times.size() != t.factors.size())
                    e.reject("times", fmt::format("found {} times and {} factors, expected as many of both, "
                                                  "one at least",
                                                  t.times.size(), t.factors.size()));
                for (std::size_t k = 1; k < t.times.size(); ++k)
                    if (!(t.times[k] > t.times[k - 1])) {
                        e.reject("times", "found times that do not rise, expected them in order");
                        break;
                    }
                for (const double factor : t.factors)
                    if (!(factor >= 0 && factor <= 1)) {
                        e.reject("factors", fmt::format("found {}, expected 0 to 1", factor));
                        break;
                    }
                if (t.of.empty())
                    e.reject("of", "found nothing, expected bond, friction, or both");
                for (const std::string& what : t.of)
                    if (what != "bond" && what != "friction")
                        e.reject("of", fmt::format("found \"{}\", expected bond, friction, or both", what));
            });
        },
        "strength that goes down in time: {times, factors, of, stage, start, region}");
}

std::vector<SceneSettings::AreaText> SceneSettings::weakening_areas() const {
    std::vector<AreaText> areas;
    for (const auto& t : reductions_)
        areas.push_back(t->area);
    return areas;
}

std::vector<SceneSettings::AreaText> SceneSettings::release_areas() const {
    std::vector<AreaText> areas;
    for (const auto& t : stages_)
        if (t->release && t->area.given())
            areas.push_back(t->area);
    return areas;
}

void SceneSettings::add_materials() {
    settings_.objects(
        "materials",
        [this](std::size_t index, cli::Settings& e) {
            while (materials_.size() <= index)
                materials_.push_back(std::make_unique<MaterialText>());
            MaterialText& m = *materials_[index];
            e.optional_number("density", m.density, Unit::density, "auto: material's", cli::positive);
            e.optional_number("youngs_modulus", m.youngs_modulus, Unit::pressure, "auto: material's",
                              cli::positive);
            e.optional_number("poissons_ratio", m.poissons_ratio, Unit::none, "auto: material's", {0, 0.5});
            e.optional_number("restitution", m.restitution, Unit::none, "auto: material's",
                              {0, 1, true, false});
            e.optional_number("friction", m.friction, Unit::none, "auto: material's", cli::not_negative);
        },
        "of grains with the material number 1, 2, ... in the model; what is left out is material's");
}

void SceneSettings::add_walls() {
    settings_.objects(
        "walls",
        [this](std::size_t index, cli::Settings& e) {
            while (walls_.size() <= index)
                walls_.push_back(std::make_unique<WallText>());
            WallText& w = *walls_[index];
            w.name = fmt::format("wall{}", index);
            e.text("name", w.name, "its name in the series");
            e.vec3("plane.point", w.point, Unit::length, "a point of the plane");
            e.vec3("plane.normal", w.normal, Unit::none, "towards the grains");
            e.text(
                "mesh", w.mesh,
                "instead of the plane: a surface (STL, OFF, PLY, OBJ), open or closed, touched from either "
                "side; in map coordinates, of which the model's origin is taken off");
            e.optional_number("map.cell", w.cell, Unit::length,
                              "of a plane: record the pressure on square cells of this size (a mesh has its "
                              "triangles)",
                              cli::positive);
            e.number("map.half_width", w.half_width, Unit::length,
                     "of the square of cells around plane.point", cli::positive);
            e.vec3("velocity", w.velocity, Unit::velocity, "of the wall");
            e.optional_number("material.youngs_modulus", w.youngs_modulus, Unit::pressure,
                              "auto: the grains'", cli::positive);
            e.optional_number("material.poissons_ratio", w.poissons_ratio, Unit::none, "auto: the grains'",
                              {0, 0.5});
            e.optional_number("material.restitution", w.restitution, Unit::none, "auto: the grains'",
                              {0, 1, true, false});
            e.optional_number("material.friction", w.friction, Unit::none,
                              "between grain and wall; auto: the grains'", cli::not_negative);
            e.check([&e, &w] {
                if (!w.mesh.empty() && e.given("plane"))
                    e.reject("mesh", "found a mesh and a plane, expected one of them");
                if (w.name.empty() || w.name == "." || w.name.find('/') != std::string::npos)
                    e.reject("name", fmt::format("found \"{}\", expected a name without /", w.name));
                if (!w.mesh.empty() && w.cell)
                    e.reject("map.cell",
                             "found cells and a mesh, expected none: the map is of its triangles");
                if (!w.cell && e.given("map"))
                    e.reject("map", "found no map.cell, expected the size of the cells");
                if (w.cell && w.half_width / *w.cell > 1000)
                    e.reject("map.cell", fmt::format("found {} cells along each side, expected 2000 at most",
                                                     std::ceil(2 * w.half_width / *w.cell)));
                if (norm(w.normal) == 0)
                    e.reject("plane.normal", "found a zero vector, expected a direction");
            });
        },
        "walls: {name, plane: {point, normal} or mesh, velocity, material, map}");
}

void SceneSettings::add_monitors() {
    settings_.objects(
        "monitors",
        [this](std::size_t index, cli::Settings& e) {
            while (monitors_.size() <= index)
                monitors_.push_back(std::make_unique<engine::Monitor>());
            engine::Monitor& m = *monitors_[index];
            m.name = fmt::format("monitor{}", index);
            e.text("name", m.name, "its name in the series");
            e.vec3("box.lower", m.lower, Unit::length, "lower corner, in map coordinates");
            e.vec3("box.upper", m.upper, Unit::length, "upper corner, in map coordinates");
            e.check([&e, &m] {
                for (int k = 0; k < 3; ++k)
                    if (!(m.upper[k] > m.lower[k])) {
                        e.reject("box.upper", "found a corner not above box.lower, expected upper > lower");
                        return;
                    }
                if (m.name.empty() || m.name == "." || m.name.find('/') != std::string::npos)
                    e.reject("name", fmt::format("found \"{}\", expected a name without /", m.name));
            });
        },
        "structures of fixed grains, whose load goes into the series: {name, box: {lower, upper}}");
}

std::vector<std::string> SceneSettings::mesh_files() const {
    std::vector<std::string> files;
    for (const auto& w : walls_)
        files.push_back(w->mesh);
    return files;
}

void SceneSettings::add_stages() {
    settings_.objects(
        "stages",
        [this](std::size_t index, cli::Settings& e) {
            while (stages_.size() <= index)
                stages_.push_back(std::make_unique<StageText>());
            StageText& t = *stages_[index];
            t.name = fmt::format("stage{}", index);
            e.text("name", t.name, "its name in the trajectory");
            e.choice("until", t.until, {"", "rest"}, "rest: the stage ends when the grains are at rest");
            e.optional_number("limit", t.limit, Unit::time, "longest time until rest, from the stage's start",
                              cli::positive);
            e.optional_number("end", t.end, Unit::time, "duration of the stage, from its own start",
                              cli::positive);
            e.flag("release", t.release, "break the bonds across the rupture surface at its start");
            t.release_bonds = "surface";
            e.choice("release_bonds", t.release_bonds, {"surface", "mass"},
                     "with release: break only the bonds across the rupture surface, or those within the "
                     "released mass too");
            e.optional_number("damping.viscous", t.viscous, Unit::frequency, "instead of the scene's",
                              cli::not_negative);
            add_area(e, "release_area", t.area, t.lower, t.upper);
            e.check([&e, &t] {
                if (t.area.given() && !t.release)
                    e.reject("release", "found a release_area without release, expected release: true");
                if (t.until == "rest" && !t.limit)
                    e.reject("until",
                             "found no /limit with it, expected the longest time to wait, such as \"20s\"");
                if (t.until != "rest" && !t.end)
                    e.reject("name",
                             "found a stage without an end, expected /end or /until \"rest\" with /limit");
            });
        },
        "parts of the run, one after the other");
}

void SceneSettings::add_triaxial() {
    cli::Settings& s = settings_;
    engine::Triaxial& t = triaxial_;
    s.optional_section("triaxial",
                       "a triaxial test of the model's grains: platens, membrane, stages of its own");
    s.number("triaxial.confining_stress", t.confining_stress, Unit::pressure, "that the membrane carries",
             cli::not_negative);
    s.number("triaxial.platen_velocity", t.platen_velocity, Unit::velocity, "of the top platen, downwards",
             cli::positive);
    s.number("triaxial.axial_strain", t.axial_strain, Unit::none, "at which the test ends",
             {0, 0.5, true, false});
    s.number("triaxial.velocity_ramp", t.velocity_ramp, Unit::none,
             "axial strain over which the platen comes to its speed", {0, 0.1});
    s.number("triaxial.bedding", t.bedding, Unit::none,
             "how far the platens stand in the specimen's uneven ends, in mean radii", {0, 1});
    s.optional_number("triaxial.platen_friction", t.platen_friction, Unit::none,
                      "between platens and grains; auto: the grains'; 0: lubricated ends", cli::not_negative);
    s.optional_number("triaxial.membrane_youngs_modulus", t.membrane_youngs_modulus, Unit::pressure,
                      "of the sheet; auto: a thousandth of the grains', at least 2.5 confining stresses",
                      cli::positive);
    s.optional_number("triaxial.membrane_radius", t.membrane_radius, Unit::length,
                      "of its particles; auto: the grains' mean", cli::positive);
    s.number("triaxial.membrane_friction", t.membrane_friction, Unit::none, "between membrane and grains",
             cli::not_negative);
    s.number("triaxial.membrane_damping", t.membrane_damping, Unit::none, "of its edges, of critical damping",
             {0, 1});
    s.optional_number("triaxial.consolidation_time", t.consolidation_time, Unit::time,
                      "in which the confining stress comes up; auto: 20 times a wave through the specimen",
                      cli::positive);
    s.number("triaxial.consolidation_limit", t.consolidation_limit, Unit::none,
             "of that time, after which the shear begins in any case", {1, 1000});
    s.number("triaxial.consolidation_tolerance", t.consolidation_tolerance, Unit::none,
             "of the confining stress, to which both stresses are brought first", cli::positive);
}

void SceneSettings::check() const {
    const bool test = settings_.given("triaxial");
    const std::pair<const char*, bool> of_others[] = {{"stages", !stages_.empty()},
                                                      {"walls", !walls_.empty()},
                                                      {"monitors", !monitors_.empty()},
                                                      {"time.end", end_.has_value()},
                                                      {"box", settings_.given("box")}};
    for (const auto& [key, found] : of_others)
        if (test && found)
            settings_.reject(key, "found beside triaxial, expected none: the test brings its own");
    if (test && norm(scene_.gravity) != 0 && scene_.gravity != engine::Scene{}.gravity)
        settings_.reject("gravity", "found some beside triaxial, expected none: the test is without gravity");
    for (const auto& [key, found] :
         {std::pair{"shaking", settings_.given("shaking")}, {"strength_reduction", !reductions_.empty()}})
        if (test && found)
            settings_.reject(key, "found beside triaxial, expected none: the specimen stands on platens");
    if (settings_.given("shaking") && accelerogram.empty())
        settings_.reject("shaking", "found no /shaking/file, expected an accelerogram");
    std::vector<std::pair<std::string, std::string>> named{{"shaking.stage", shaking_onset_.stage},
                                                           {"output.travel_from", travel_from}};
    for (std::size_t k = 0; k < reductions_.size(); ++k)
        named.emplace_back(fmt::format("strength_reduction.{}.stage", k),
                           reductions_[k]->reduction.onset.stage);
    for (const auto& [key, name] : named)
        if (!name.empty() && std::none_of(stages_.begin(), stages_.end(),
                                          [&](const auto& stage) { return stage->name == name; }))
            settings_.reject(key, fmt::format("found \"{}\", expected the name of a stage", name));
    if (travel_interval_fine_ && !travel_interval_)
        settings_.reject("output.travel_interval_fine",
                         "found one without output.travel_interval, expected that for a single interval");
    if (!travel_from.empty() && !travel_interval_)
        settings_.reject("output.travel_from", "found a stage but no output.travel_interval, expected both");
    if (change_tolerance && !changed_only)
        settings_.reject("output.change_tolerance",
                         "found one without output.changed_only, expected changed_only: true");
    for (std::size_t k = 0; k < reductions_.size(); ++k)
        if (!settings_.given("bond") && reductions_[k]->of == std::vector<std::string>{"bond"})
            settings_.reject(fmt::format("strength_reduction.{}.of", k),
                             "found bonds that weaken, but the scene has none, expected /bond");
    if (scene_.sleep_tolerance > 0 && test)
        settings_.reject("sleep.tolerance",
                         "found a value above 0 beside triaxial, expected 0: nothing rests there");
    if (scene_.sleep_tolerance > 0 && norm(scene_.gravity) == 0)
        settings_.reject(
            "sleep.tolerance",
            "found a value above 0 without gravity, expected 0: rest is measured against the weight");
    const bool linear = law_ == "linear";
    if (linear && !(linear_.normal_stiffness > 0))
        settings_.reject("contact.normal_stiffness",
                         "found none above zero, expected the linear law's k_n in N/m");
    if (linear && scene_.material.friction > 0 && !(linear_.tangential_stiffness > 0))
        settings_.reject("contact.tangential_stiffness",
                         "found none above zero, expected the linear law's k_t in N/m: there is friction");
    if (linear && linear_.tangential_damping > 0 && !(linear_.normal_damping > 0))
        settings_.reject("contact.tangential_damping",
                         "found a value above zero without contact.normal_damping, expected both or neither");
    if (linear && settings_.given("bond"))
        settings_.reject("contact.law", "found \"linear\" and a bond, expected \"hertz-mindlin\" with bonds");
    if (linear && !materials_.empty())
        settings_.reject(
            "materials",
            "found materials, but contact.law is \"linear\", expected them with \"hertz-mindlin\"");
    if (materials_.size() > most_materials)
        settings_.reject("materials", fmt::format("found {} materials, expected at most {}",
                                                  materials_.size(), most_materials));
    for (const auto& [key, value] : {std::pair{"contact.normal_stiffness", linear_.normal_stiffness},
                                     {"contact.tangential_stiffness", linear_.tangential_stiffness},
                                     {"contact.normal_damping", linear_.normal_damping},
                                     {"contact.tangential_damping", linear_.tangential_damping}})
        if (!linear && value > 0)
            settings_.reject(
                key, "found a value, but contact.law is \"hertz-mindlin\", expected it with \"linear\"");
    if (settings_.given("box"))
        for (int k = 0; k < 3; ++k)
            if (!(box_.upper[k] > box_.lower[k]))
                settings_.reject("box.upper", "found a corner not above box.lower, expected upper > lower");
    if (!test && stages_.empty() && !end_ && !settings_.given("time.end"))
        settings_.reject("time.end", "found neither time.end nor stages, expected one of them");
    if (!stages_.empty() && end_)
        settings_.reject("time.end", "found both time.end and stages, expected one of them");
    for (const std::string& field : fields)
        if (field != "position" && field != "velocity" && field != "angular_velocity" && field != "force")
            settings_.reject(
                "output.fields",
                fmt::format("found \"{}\", expected position, velocity, angular_velocity or force", field));
    for (std::size_t a = 0; a < walls_.size(); ++a)
        for (std::size_t b = 0; b < a; ++b)
            if (walls_[a]->name == walls_[b]->name)
                settings_.reject(
                    "walls",
                    fmt::format("found two walls named \"{}\", expected different names", walls_[a]->name));
    for (std::size_t a = 0; a < monitors_.size(); ++a)
        for (std::size_t b = 0; b < a; ++b)
            if (monitors_[a]->name == monitors_[b]->name)
                settings_.reject("monitors",
                                 fmt::format("found two monitors named \"{}\", expected different names",
                                             monitors_[a]->name));
}

engine::Scene SceneSettings::scene() const {
    engine::Scene scene = scene_;
    if (settings_.given("bond"))
        scene.bond = bond_;
    if (settings_.given("box"))
        scene.box = box_;
    if (separation_ == "no-tension")
        scene.separation = contact::Separation::no_tension;
    if (damping_ == "exact")
        scene.damping_rule = contact::DampingRule::exact;
    if (lever_arm_ == "radius")
        scene.lever_arm = contact::LeverArm::radius;
    if (law_ == "linear")
        scene.linear_law = linear_;
    scene.mixed_precision = precision_ == "mixed";
    scene.reference_kernel = kernel_ == "reference";
    for (const auto& given : materials_) {
        Material m = scene.material;
        m.density = given->density.value_or(m.density);
        m.youngs_modulus = given->youngs_modulus.value_or(m.youngs_modulus);
        m.poissons_ratio = given->poissons_ratio.value_or(m.poissons_ratio);
        m.restitution = given->restitution.value_or(m.restitution);
        m.friction = given->friction.value_or(m.friction);
        scene.more_materials.push_back(m);
    }
    for (const auto& w : walls_) {
        Material m = scene.material;
        m.youngs_modulus = w->youngs_modulus.value_or(m.youngs_modulus);
        m.poissons_ratio = w->poissons_ratio.value_or(m.poissons_ratio);
        m.restitution = w->restitution.value_or(m.restitution);
        m.friction = w->friction.value_or(m.friction);
        engine::Wall wall{w->name, w->point, w->normal, w->velocity, m};
        if (w->cell)
            wall.patches = engine::PatchGrid{*w->cell, w->half_width};
        scene.walls.push_back(wall);
    }
    std::uint8_t area_mark = 2; // as tiling::release_marks has them
    for (const auto& m : monitors_)
        scene.monitors.push_back(*m);
    for (const auto& t : stages_) {
        engine::Stage stage;
        stage.name = t->name;
        stage.until_rest = t->until == "rest";
        stage.limit = t->limit.value_or(0);
        stage.end = t->end.value_or(0);
        stage.release = t->release;
        stage.release_mass = t->release_bonds == "mass";
        stage.viscous_damping = t->viscous;
        stage.release_marks = t->release && t->area.given() ? area_mark : 1;
        if (t->release && t->area.given())
            area_mark = static_cast<std::uint8_t>(area_mark << 1);
        scene.stages.push_back(stage);
    }
    for (const auto& t : reductions_) {
        engine::StrengthReduction& reduction = scene.strength_reductions.emplace_back(t->reduction);
        for (std::size_t k = 0; k < t->times.size(); ++k)
            reduction.factor.push_back({t->times[k], t->factors[k]});
        reduction.bond = std::find(t->of.begin(), t->of.end(), "bond") != t->of.end();
        reduction.friction = std::find(t->of.begin(), t->of.end(), "friction") != t->of.end();
    }
    if (settings_.given("shaking"))
        scene.shaking.emplace().onset = shaking_onset_;
    for (const auto& interval : {travel_interval_, travel_interval_fine_})
        if (interval)
            scene.travel_intervals.push_back(*interval);
    if (settings_.given("triaxial")) {
        scene.triaxial = triaxial_;
        scene.gravity = {};
    } else if (scene.stages.empty()) {
        engine::Stage whole;
        whole.end = end_.value_or(0);
        scene.stages.push_back(whole);
    }
    return scene;
}

} // namespace talus::dem_run
