// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/checkpoint_file.hpp"
#include "io/quick_check.hpp"
#include "io/trajectory_file.hpp"

#include <cstring>
#include <string>

/// Comparison of whole files by all that their readers give.
namespace talus::io::test {

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

/// What differs first; empty: nothing. Checksums of both are tested.
inline std::string trajectory_difference(const std::string& a, const std::string& b) {
    check_all(a);
    check_all(b);
    const TrajectoryReader one(a), other(b);
    const TrajectoryStatic &s = one.statics(), &t = other.statics();
    if (!same_bits(s.radius, t.radius) || !same_bits(s.mass, t.mass) || !same_bits(s.species, t.species) ||
        !same_bits(s.release, t.release) || !same_bits(s.material, t.material))
        return "columns of particles";
    if (s.origin != t.origin || s.coordinate_system != t.coordinate_system || s.box != t.box ||
        s.float64 != t.float64)
        return "frame of reference";
    if (one.fields() != other.fields())
        return "names of fields";
    if (one.frames() != other.frames())
        return "number of frames";
    for (std::size_t f = 0; f < one.frames(); ++f) {
        if (one.step(f) != other.step(f) || one.time(f) != other.time(f))
            return "step or time of frame " + std::to_string(f);
        for (const std::string& field : one.fields())
            if (!same_bits(one.read(f, field), other.read(f, field)))
                return field + " of frame " + std::to_string(f);
    }
    if (one.series_names() != other.series_names())
        return "names of series";
    for (const std::string& name : one.series_names())
        if (!same_bits(one.series(name), other.series(name)))
            return "series " + name;
    if (one.stages() != other.stages())
        return "stages";
    if (one.bond_breakages() != other.bond_breakages())
        return "breakages";
    if (one.config() != other.config() || one.provenance().size() != other.provenance().size())
        return "configuration or provenance";
    return "";
}

inline std::string checkpoint_difference(const std::string& a, const std::string& b) {
    check_all(a);
    check_all(b);
    const CheckpointFile one = read_checkpoint(a), other = read_checkpoint(b);
    if (one.attributes != other.attributes || one.config != other.config ||
        one.provenance.size() != other.provenance.size())
        return "attributes, configuration or provenance";
    if (one.columns.size() != other.columns.size())
        return "number of columns";
    for (std::size_t c = 0; c < one.columns.size(); ++c)
        if (one.columns[c] != other.columns[c])
            return "column " + one.columns[c].name;
    return "";
}

} // namespace talus::io::test
