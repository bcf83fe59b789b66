// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/resumed_trajectory.hpp"

#include "io/atomic_file.hpp"

#include <filesystem>

namespace talus::dem_run {

namespace {

void copy_until(const io::TrajectoryReader& from, std::int64_t step, io::TrajectoryWriter& to) {
    for (const io::StageMark& mark : from.stages())
        if (mark.step <= step)
            to.stage(mark);
    const std::vector<std::string> names = from.series_names();
    std::vector<std::vector<double>> columns;
    std::size_t rows = 0;
    for (const std::string& name : names) {
        columns.push_back(from.series(name));
        if (name == "step")
            while (rows < columns.back().size() && columns.back()[rows] <= static_cast<double>(step))
                ++rows;
    }
    for (std::size_t row = 0; row < rows; ++row) {
        std::vector<std::pair<std::string, double>> values;
        for (std::size_t c = 0; c < names.size(); ++c)
            values.emplace_back(names[c], columns[c][row]);
        to.series(values);
    }
    for (std::size_t frame = 0; frame < from.frames() && from.step(frame) <= step; ++frame) {
        std::vector<std::vector<Vec3>> values;
        std::vector<io::TrajectoryWriter::Field> fields;
        for (const std::string& name : from.fields())
            values.push_back(from.read(frame, name));
        for (std::size_t f = 0; f < values.size(); ++f)
            fields.emplace_back(from.fields()[f], values[f]);
        to.frame(from.step(frame), from.time(frame), fields);
    }
    std::vector<io::BondBreakage> breaks;
    for (const io::BondBreakage& b : from.bond_breakages())
        if (b.step <= step)
            breaks.push_back(b);
    to.bond_breakages(breaks);
    to.flush();
}

} // namespace

ResumedTrajectory::ResumedTrajectory(const std::string& path, const io::TrajectoryStatic& statics,
                                     const io::Provenance& provenance, const std::string& config,
                                     bool overwrite, std::int64_t resume_step) {
    namespace fs = std::filesystem;
    // Set aside first: an interruption while copying then finds the whole of it again.
    const std::string unfinished = io::partial_path(path), aside = path + ".resume";
    if (resume_step < 0) {
        std::error_code ignored;
        fs::remove(aside, ignored);
    } else if (!fs::exists(aside) && fs::exists(unfinished)) {
        fs::rename(unfinished, aside);
    }
    writer_ = std::make_unique<io::TrajectoryWriter>(path, statics, provenance, config, overwrite);
    if (resume_step < 0 || !fs::exists(aside))
        return;
    copy_until(io::TrajectoryReader(aside, io::TrajectoryReader::Accept::incomplete), resume_step, *writer_);
    fs::remove(aside);
    continues_ = true;
}

} // namespace talus::dem_run
