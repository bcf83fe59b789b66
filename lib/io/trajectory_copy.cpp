// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/trajectory_file.hpp"

namespace talus::io {

void write_full_frames(const std::string& from, const std::string& to, const Provenance& provenance,
                       bool overwrite, const std::function<void(double)>& each) {
    const TrajectoryReader in(from, TrajectoryReader::Accept::incomplete);
    TrajectoryWriter out(to, in.statics(), provenance, in.config(), overwrite);
    for (const StageMark& mark : in.stages())
        out.stage(mark);
    const std::vector<std::string> names = in.fields();
    for (std::size_t k = 0; k < in.frames(); ++k) {
        std::vector<std::vector<Vec3>> values;
        std::vector<TrajectoryWriter::Field> fields;
        for (const std::string& name : names)
            values.push_back(in.read(k, name));
        for (std::size_t f = 0; f < names.size(); ++f)
            fields.emplace_back(names[f], values[f]);
        out.frame(in.step(k), in.time(k), fields);
        if (each)
            each(static_cast<double>(k + 1) / static_cast<double>(in.frames()));
    }
    const std::vector<std::string> columns = in.series_names();
    std::vector<std::vector<double>> series;
    std::size_t rows = columns.empty() ? 0 : in.series(columns.front()).size();
    for (const std::string& name : columns) {
        series.push_back(in.series(name));
        rows = std::min(rows, series.back().size()); // a killed run may have begun one more in some
    }
    for (std::size_t row = 0; row < rows; ++row) {
        std::vector<std::pair<std::string, double>> values;
        for (std::size_t c = 0; c < columns.size(); ++c)
            values.emplace_back(columns[c], series[c][row]);
        out.series(values);
    }
    out.bond_breakages(in.bond_breakages());
    for (const char* name : {"initial_depth", "travel_distance", "travel_distance_fine"}) {
        const std::vector<double> column = in.column(name);
        std::vector<std::pair<std::string, double>> attributes;
        for (const char* key : {"interval", "from_step", "from_time"})
            if (const auto value = in.column_attribute(name, key))
                attributes.emplace_back(key, *value);
        if (!column.empty())
            out.column(name, "m", column, attributes);
    }
    if (const std::vector<double> surface = in.column("surface"); !surface.empty()) {
        std::vector<std::uint8_t> flags(surface.size());
        for (std::size_t i = 0; i < flags.size(); ++i)
            flags[i] = surface[i] != 0;
        out.column("surface", flags);
    }
    out.finish();
}

} // namespace talus::io
