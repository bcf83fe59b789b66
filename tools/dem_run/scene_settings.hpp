// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/settings.hpp"
#include "engine/scene.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace talus::dem_run {

/// The scene as the configuration file and the switches spell it; `scene()` turns it into the engine's.
class SceneSettings {
public:
    /// Registers every key of the scene.
    explicit SceneSettings(cli::Settings& settings);

    /// To be called after the settings are read.
    /// Meshes and monitors are in map coordinates still, see place_structures().
    engine::Scene scene() const;
    /// Of each wall; empty: a plane.
    std::vector<std::string> mesh_files() const;

    std::vector<std::string> fields{"position", "velocity"};
    bool float64 = false;
    bool changed_only = false;
    std::optional<double> change_tolerance; ///< m
    bool surface_labels = false;
    std::string travel_from; ///< stage; empty: the first that releases, or the first

    /// A region of the map as the scene names it; nothing given: everything.
    struct AreaText {
        std::string outline; ///< file
        std::optional<Vec3> lower, upper;
        bool given() const { return !outline.empty() || lower || upper; }
    };
    /// Of each strength reduction.
    std::vector<AreaText> weakening_areas() const;
    /// Of those stages that release what lies in an area, in their order; the k-th one's mark is 2 << k.
    std::vector<AreaText> release_areas() const;
    std::string accelerogram; ///< file of shaking; empty: none
    double accelerogram_scale = 1;

private:
    struct WallText {
        std::string name, mesh;
        Vec3 point, normal{0, 0, 1}, velocity;
        std::optional<double> youngs_modulus, poissons_ratio, restitution, friction, cell;
        double half_width = 1;
    };
    struct MaterialText {
        std::optional<double> density, youngs_modulus, poissons_ratio, restitution, friction;
    };
    struct StageText {
        std::string name, until, release_bonds;
        std::optional<double> limit, end, viscous;
        bool release = false;
        AreaText area;
        Vec3 lower, upper;
    };
    struct ReductionText {
        engine::StrengthReduction reduction;
        std::vector<double> times, factors;
        std::vector<std::string> of{"bond", "friction"};
        AreaText area;
        Vec3 lower, upper;
    };
    void add_materials();
    void add_walls();
    void add_monitors();
    void add_stages();
    void add_triaxial();
    void add_triggers();
    void add_output();
    static void add_area(cli::Settings& e, const std::string& key, AreaText& area, Vec3& lower, Vec3& upper);
    void check() const;

    cli::Settings& settings_;
    engine::Scene scene_;
    BondMaterial bond_;
    engine::Triaxial triaxial_;
    Box box_;
    std::optional<double> end_;
    contact::LinearLaw linear_;
    std::string law_ = "hertz-mindlin", separation_ = "tension", damping_ = "paper",
                lever_arm_ = "contact-point", precision_ = "double", kernel_ = "specialised";
    std::vector<std::unique_ptr<MaterialText>> materials_;
    std::vector<std::unique_ptr<WallText>> walls_;
    std::vector<std::unique_ptr<engine::Monitor>> monitors_;
    std::vector<std::unique_ptr<StageText>> stages_;
    engine::Onset shaking_onset_;
    std::vector<std::unique_ptr<ReductionText>> reductions_;
    std::optional<double> travel_interval_, travel_interval_fine_;
};

} // namespace talus::dem_run
