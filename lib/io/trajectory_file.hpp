// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "io/provenance.hpp"
#include "io/together.hpp"
#include "io/trajectory_image.hpp"
#include "particles/box.hpp"
#include "particles/grains.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace talus::io {

/// What stays the same over a trajectory; row i is particle i. Empty columns are not written.
struct TrajectoryStatic {
    std::vector<double> radius;         ///< m
    std::vector<double> mass;           ///< kg
    std::vector<Species> species;       ///< empty: all grain
    std::vector<std::uint8_t> release;  ///< 1: released mass; empty: none
    std::vector<std::uint8_t> material; ///< index into the scene's materials; empty: all 0
    Vec3 origin;                        ///< m, of the local coordinates in the map's system
    std::string coordinate_system;      ///< WKT; empty: none
    Box box;                            ///< m, relative to `origin`
    bool float64 = false;               ///< vectors of frames in f64 instead of f32

    std::size_t size() const { return radius.size(); }
};

/// Where a stage of the run starts.
struct StageMark {
    std::string name;
    std::int64_t step = 0;
    double time = 0; ///< s
    friend bool operator==(const StageMark&, const StageMark&) = default;
};

/// A bond that broke: between particles i < j, at `position` (m, relative to the origin).
struct BondBreakage {
    std::int64_t step = 0;
    double time = 0; ///< s
    std::int64_t i = 0, j = 0;
    Vec3 position;
    std::uint8_t mode = 0; ///< 0 tension, 1 shear, 2 release
    friend bool operator==(const BondBreakage&, const BondBreakage&) = default;
};

/// What a wall took over a run. One with a map has patches: the faces of a mesh, or cells of a plane.
struct WallMap {
    std::string name;
    Vec3 impulse;                            ///< N s, of all forces on the wall
    double peak_force = 0;                   ///< N, the largest in any step
    Vec3 peak_force_vector;                  ///< N
    double peak_force_time = 0;              ///< s
    std::optional<double> first_impact_time; ///< s; empty: nothing touched it

    std::vector<Vec3> points;           ///< m, relative to the origin, at the end of the run
    std::size_t sides = 3;              ///< corners of a patch
    std::vector<std::uint32_t> corners; ///< numbers of points, `sides` for each patch
    std::vector<double> area;           ///< m2, of each patch
    std::vector<Vec3> impulse_of_patch; ///< N s
    std::vector<double> normal_impulse; ///< N s
    std::vector<double> mean_pressure;  ///< Pa, over the whole run
    std::vector<double> peak_pressure;  ///< Pa, the largest in any step
    std::vector<double> peak_time;      ///< s
};

/// Writes `*.traj.h5` frame by frame under the temporary name partial_path(path); a killed run leaves all
/// frames before the last call of frame() readable there. Without finish() the destructor removes the file,
/// and so does a failure; but not once an image() was taken, for a resumed run goes on with it. Every call
/// throws Error run_failed where writing fails. Not for use by two threads at once (HDF5 is not).
///
/// Several ranks write one file together: every call is then collective, statics and fields of frames hold
/// the rank's rows, everything else is the same on all ranks. An Error is thrown on all of them; they must
/// then end at once, by _exit: the HDF5 library may not be able to close the file, and waits for that at a
/// regular end.
class TrajectoryWriter {
public:
    /// @param rows which particles `statics` and the frames hold; total 0: all
    /// @throws Error output_exists where `path` exists and `overwrite` is false.
    TrajectoryWriter(const std::string& path, TrajectoryStatic statics, const Provenance& provenance,
                     const std::string& config, bool overwrite, const Together& together = {},
                     Rows rows = {});
    /// Goes on with what an interrupted run left under partial_path(path), from where `image` was taken; what
    /// came after is dropped. The number of ranks may be another. Fields and series columns are those that
    /// the file has, given in any order.
    /// @throws Error input_invalid where that file is missing, shorter than the image tells or another run's,
    /// or where `statics` do not fit; later where the fields of a frame or the columns of the series do not.
    /// The file is left where it is.
    static TrajectoryWriter resume(const std::string& path, const TrajectoryImage& image,
                                   TrajectoryStatic statics, const Provenance& provenance,
                                   const std::string& config, bool overwrite, const Together& together = {},
                                   Rows rows = {});
    ~TrajectoryWriter();
    TrajectoryWriter(TrajectoryWriter&&) noexcept;
    TrajectoryWriter& operator=(TrajectoryWriter&&) = delete;

    using Field = std::pair<std::string, std::span<const Vec3>>;

    /// Appends one frame and flushes. The first call fixes the fields; "position" (m, relative to the origin)
    /// is one of them, "velocity" (m s-1), "angular_velocity" (rad s-1), "force" (N) may be. Row i = particle
    /// i (of this rank).
    void frame(std::int64_t step, double time, const std::vector<Field>& fields);

    /// Appends a frame of some particles only, with the fields of frame(), which must have been called
    /// before: all others are as they were last written. `particles` are numbers in the whole trajectory,
    /// rising; `rows` says where this rank's stand among those of all ranks (total 0: all are here). Such
    /// frames are kept beside the full ones, which alone make up /particles/all: a reader of H5MD sees these,
    /// TrajectoryReader sees all.
    void changes(std::int64_t step, double time, std::span<const std::uint64_t> particles,
                 const std::vector<Field>& fields, Rows rows = {});

    /// Writes /particles/all/<name>, one value a particle that does not depend on time, with these
    /// attributes. A resumed file that has it keeps what it has.
    void column(const std::string& name, std::string_view unit, std::span<const double> values,
                const std::vector<std::pair<std::string, double>>& attributes = {});
    void column(const std::string& name, std::span<const std::uint8_t> values);

    /// Appends a row to /granular/series/<name>; names may contain '/'. The first call fixes the columns;
    /// "step" and "time" are two of them. Rows reach the file with the next frame or every 1024 rows.
    void series(const std::vector<std::pair<std::string, double>>& row);

    /// Rank 0's are written.
    void bond_breakages(std::span<const BondBreakage> breakages);
    void stage(const StageMark& mark);
    /// Once, at the end; finish() then writes a second sidecar for those with patches, walls_sidecar_path().
    void walls(std::span<const WallMap> walls);

    /// Brings everything written so far to the file.
    void flush();
    /// Flushes, brings everything to the disk and tells what resume() needs to come back to here: for the
    /// checkpoint. The same on all ranks.
    TrajectoryImage image();
    /// Ends writing but leaves the incomplete file under partial_path(path), for a resumed run to go on with.
    void suspend();
    /// Marks the file complete, writes the XDMF sidecar, syncs and renames to the final name.
    void finish();

private:
    struct State;
    explicit TrajectoryWriter(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

/// The sidecar that shows the walls of a trajectory: its name with .walls.xdmf.
std::string walls_sidecar_path(const std::string& trajectory);

/// The unit of a series column by its name's last part ("force_z": "N", "time": "s"); empty where it is a
/// number without dimension or unknown.
std::string_view series_unit(std::string_view name);

/// Copies a trajectory, with all of its frames written out in full; its sidecar shows them all.
/// @param each called after each frame with the part that is done
/// @throws Error output_exists, input_invalid, run_failed
void write_full_frames(const std::string& from, const std::string& to, const Provenance& provenance,
                       bool overwrite, const std::function<void(double)>& each = {});

/// Reads `*.traj.h5`. Everything throws Error input_invalid naming file, place and cure.
class TrajectoryReader {
public:
    enum class Accept { complete, incomplete };

    /// @param accept `incomplete` opens what a killed run left, too.
    explicit TrajectoryReader(const std::string& path, Accept accept = Accept::complete);
    ~TrajectoryReader();
    TrajectoryReader(TrajectoryReader&&) noexcept;
    TrajectoryReader& operator=(TrajectoryReader&&) noexcept;

    const TrajectoryStatic& statics() const;
    bool complete() const;
    std::size_t frames() const;
    double time(std::size_t frame) const; ///< s
    std::int64_t step(std::size_t frame) const;
    bool has(const std::string& field) const;
    std::vector<std::string> fields() const;
    /// Row i = particle i; positions relative to statics().origin. A frame that was written as changes is put
    /// together from those before; one after the other costs least.
    std::vector<Vec3> read(std::size_t frame, const std::string& field) const;

    /// How many frames hold all particles; the others changes only.
    std::size_t full_frames() const;
    /// A column that TrajectoryWriter::column wrote; empty where there is none.
    std::vector<double> column(const std::string& name) const;
    /// A number that stands with it.
    std::optional<double> column_attribute(const std::string& name, const std::string& attribute) const;

    std::vector<StageMark> stages() const;
    std::vector<std::string> series_names() const; ///< sorted
    std::vector<double> series(const std::string& name) const;
    std::vector<BondBreakage> bond_breakages() const;
    std::vector<WallMap> walls() const; ///< sorted by name
    Provenance provenance() const;
    std::string config() const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace talus::io
