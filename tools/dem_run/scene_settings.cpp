// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/scene_settings.hpp"

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

    s.optional_number("time.end", end_, Unit::time, "end of the run, where there are no stages",
                      cli::positive);
    s.optional_number("time.step", scene_.step, Unit::time,
                      "time step, kept exactly; auto: from step_fraction", cli::positive);
    s.number("time.step_fraction", scene_.step_fraction, Unit::none, "of the smallest grain's Rayleigh time",
             cli::positive);
    s.flag("time.allow_unstable", scene_.allow_unstable, "accept a step above the stable limit");
    s.number("damping.viscous", scene_.viscous_damping, Unit::frequency, "force -c m v; for settling",
             cli::not_negative);
    s.number("sleep.tolerance", sleep_tolerance_, Unit::none, "0: nothing sleeps", cli::not_negative);
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
    add_stages();
    add_triaxial();
    s.check([this] { check(); });
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
            e.text("mesh", w.mesh, "surface file");
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
                if (!w.mesh.empty())
                    e.reject("mesh", "found a mesh, expected a plane: walls of this version are planes");
                if (norm(w.normal) == 0)
                    e.reject("plane.normal", "found a zero vector, expected a direction");
            });
        },
        "plane walls: {name, plane: {point, normal}, velocity, material}");
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
            e.check([&e, &t] {
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
    s.number("triaxial.platen_friction", t.platen_friction, Unit::none,
             "between platens and grains; 0: lubricated ends", cli::not_negative);
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
                                                      {"time.end", end_.has_value()},
                                                      {"box", settings_.given("box")}};
    for (const auto& [key, found] : of_others)
        if (test && found)
            settings_.reject(key, "found beside triaxial, expected none: the test brings its own");
    if (test && norm(scene_.gravity) != 0 && scene_.gravity != engine::Scene{}.gravity)
        settings_.reject("gravity", "found some beside triaxial, expected none: the test is without gravity");
    if (sleep_tolerance_ != 0)
        settings_.reject("sleep.tolerance",
                         "found a value above 0, expected 0: this version computes every grain");
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
        scene.walls.push_back({w->name, w->point, w->normal, w->velocity, m});
    }
    for (const auto& t : stages_) {
        engine::Stage stage;
        stage.name = t->name;
        stage.until_rest = t->until == "rest";
        stage.limit = t->limit.value_or(0);
        stage.end = t->end.value_or(0);
        stage.release = t->release;
        stage.release_mass = t->release_bonds == "mass";
        stage.viscous_damping = t->viscous;
        scene.stages.push_back(stage);
    }
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
