// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "io/provenance.hpp"
#include "particles/grains.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace talus::io {

/// What is known of an explicit model before its particles.
struct ExplicitFrame {
    Vec3 origin;                   ///< m, of the local coordinates in the map's system
    std::string coordinate_system; ///< WKT; empty: none
    std::optional<Box> box;        ///< m, relative to `origin`
    bool species = false;          ///< the model has this column
    bool release = false;          ///< and this one
    bool material = false;         ///< and this one
};

/// Writes an explicit model of any size without holding it: the same datasets as write_model(), particles by
/// particles.
class ExplicitWriter {
public:
    /// @param team filters what is written; the file is the same for any. @throws Error as write_model()
    ExplicitWriter(const std::string& path, const ExplicitFrame& frame, const Provenance& provenance,
                   const std::string& config, bool overwrite, ThreadTeam& team);
    ~ExplicitWriter();
    /// The next particles (positions, radii, and the columns that the frame names) with the contacts whose
    /// lower particle is among them; contacts name particles of the whole model and are sorted.
    /// @throws Error run_failed where writing fails or the particles are not fit to be written
    void add(const Grains& grains);
    /// Completes the file and gives it its name; without this nothing is left behind.
    void finish();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Bytes of the file that ExplicitWriter would make, without writing it.
struct ExplicitFileSize {
    std::uint64_t compressed_particles = 0; ///< of these particles: compressed columns
    std::uint64_t compressed_contacts = 0;  ///< of their contacts
    std::uint64_t others = 0;               ///< everything but columns
    /// Columns that are not compressed, of any number of particles and contacts; exact.
    static std::uint64_t plain(std::uint64_t particles, std::uint64_t contacts);
};
ExplicitFileSize explicit_file_size(const Grains& grains, const ExplicitFrame& frame,
                                    const Provenance& provenance, const std::string& config,
                                    ThreadTeam& team);

} // namespace talus::io
