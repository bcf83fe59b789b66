// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "dem_run/recorder.hpp"
#include "dem_run/scene_settings.hpp"
#include "parallel/communicator.hpp"
#include "particles/grains.hpp"

#include <nlohmann/json_fwd.hpp>

namespace talus::dem_run {

/// What the engine is to see instead of the model's columns, so that triggers find their grains; empty: the
/// model's.
struct TriggerLabels {
    std::vector<std::uint8_t> release, material;
};

/// Reads the files that the scene's triggers name, completes the scene, and marks this rank's grains.
/// Collective.
TriggerLabels prepare_triggers(engine::Scene& scene, const SceneSettings& settings, const Grains& grains,
                               const parallel::Communicator& world);

/// The released mass for the trajectory: the model's, or what any stage releases.
std::vector<std::uint8_t> released_mass(const Grains& grains, const TriggerLabels& labels);

/// What of the output depends on the grains.
OutputRules output_rules(const SceneSettings& settings, const engine::Scene& scene, const Grains& grains,
                         const parallel::Communicator& world);

/// Writes each grain's initial depth and whether it lay at the surface. Collective.
void write_surface_labels(io::TrajectoryWriter& writer, const Grains& grains,
                          const parallel::Communicator& world);

/// What a user has to know of the record: the frame of reference, and where the ground is after it.
nlohmann::json shaking_result(const engine::Accelerogram& record);

/// As prepare_triggers() gives them, for as long as the object lives.
class Labelled {
public:
    Labelled(Grains& grains, TriggerLabels labels)
        : grains_(grains), own_(std::move(labels)), release_(!own_.release.empty()),
          material_(!own_.material.empty()) {
        swap();
    }
    ~Labelled() { swap(); }
    Labelled(const Labelled&) = delete;
    Labelled& operator=(const Labelled&) = delete;

private:
    void swap() {
        if (release_)
            std::swap(own_.release, grains_.release);
        if (material_)
            std::swap(own_.material, grains_.material);
    }
    Grains& grains_;
    TriggerLabels own_;
    bool release_, material_;
};

} // namespace talus::dem_run
