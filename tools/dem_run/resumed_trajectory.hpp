// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/trajectory_file.hpp"

#include <memory>

namespace talus::dem_run {

/// A trajectory that goes on where an interrupted run's left off: what the unfinished file holds up to the
/// checkpoint's step is copied, the rest is computed again.
class ResumedTrajectory {
public:
    /// @param resume_step step of the checkpoint; -1: a new run
    ResumedTrajectory(const std::string& path, const io::TrajectoryStatic& statics,
                      const io::Provenance& provenance, const std::string& config, bool overwrite,
                      std::int64_t resume_step);

    io::TrajectoryWriter& writer() { return *writer_; }
    /// Whether an interrupted run's frames were found.
    bool continues() const { return continues_; }

private:
    std::unique_ptr<io::TrajectoryWriter> writer_;
    bool continues_ = false;
};

} // namespace talus::dem_run
