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
    engine::Scene scene() const;

    std::vector<std::string> fields{"position", "velocity"};
    bool float64 = false;

private:
    struct WallText {
        std::string name, mesh;
        Vec3 point, normal{0, 0, 1}, velocity;
        std::optional<double> youngs_modulus, poissons_ratio, restitution, friction;
    };
    struct MaterialText {
        std::optional<double> density, youngs_modulus, poissons_ratio, restitution, friction;
    };
    struct StageText {
        std::string name, until, release_bonds;
        std::optional<double> limit, end, viscous;
        bool release = false;
    };
    void add_materials();
    void add_walls();
    void add_stages();
    void add_triaxial();
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
    double sleep_tolerance_ = 0;
    std::vector<std::unique_ptr<MaterialText>> materials_;
    std::vector<std::unique_ptr<WallText>> walls_;
    std::vector<std::unique_ptr<StageText>> stages_;
};

} // namespace talus::dem_run
