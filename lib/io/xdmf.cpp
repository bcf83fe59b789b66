// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/xdmf.hpp"

#include <filesystem>
#include <fmt/format.h>

namespace talus::io {
namespace {

std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text)
        switch (c) {
        case '&':
            out += "&amp;";
            break;
        case '<':
            out += "&lt;";
            break;
        case '>':
            out += "&gt;";
            break;
        case '"':
            out += "&quot;";
            break;
        default:
            out += c;
        }
    return out;
}

std::string reference(const std::string& file, const XdmfArray& array, std::size_t frame,
                      const std::string& indent) {
    const std::string own =
        array.width > 1 ? fmt::format("{} {}", array.rows, array.width) : fmt::format("{}", array.rows);
    const std::string type = fmt::format(R"(NumberType="{}" Precision="{}")", array.number, array.precision);
    const std::string source = fmt::format("{}:{}", escaped(file), escaped(array.path));
    if (array.frames == 0)
        return fmt::format("{}<DataItem Dimensions=\"{}\" {} Format=\"HDF\">{}</DataItem>\n", indent, own,
                           type, source);
    const bool vector = array.width > 1;
    const std::string slab = vector ? fmt::format("{} 0 0  1 1 1  1 {} {}", frame, array.rows, array.width)
                                    : fmt::format("{} 0  1 1  1 {}", frame, array.rows);
    return fmt::format("{0}<DataItem ItemType=\"HyperSlab\" Dimensions=\"{1}\" Type=\"HyperSlab\">\n"
                       "{0}  <DataItem Dimensions=\"3 {2}\" Format=\"XML\">{3}</DataItem>\n"
                       "{0}  <DataItem Dimensions=\"{4} {1}\" {5} Format=\"HDF\">{6}</DataItem>\n"
                       "{0}</DataItem>\n",
                       indent, own, vector ? 3 : 2, slab, array.frames, type, source);
}

} // namespace

std::string xdmf_points(const std::string& hdf5_file, const std::string& name,
                        const std::vector<XdmfArray>& arrays, const std::vector<double>& times) {
    const std::string file = std::filesystem::path(hdf5_file).filename().string();
    const bool series = !times.empty();
    const std::string in = series ? "      " : "    ";
    std::string xml = "<?xml version=\"1.0\" ?>\n<Xdmf Version=\"2.0\">\n  <Domain>\n";
    if (series)
        xml +=
            fmt::format("    <Grid Name=\"{}\" GridType=\"Collection\" CollectionType=\"Temporal\">\n", name);
    for (std::size_t frame = 0; frame < (series ? times.size() : 1); ++frame) {
        // Where a stage ends and the next begins there is a frame of each: ParaView takes two of one time for
        // blocks of one picture and shows neither.
        if (frame + 1 < times.size() && times[frame + 1] == times[frame])
            continue;
        xml += fmt::format("{}<Grid Name=\"{}\" GridType=\"Uniform\">\n", in, name);
        if (series)
            xml += fmt::format("{}  <Time Value=\"{}\"/>\n", in, times[frame]);
        xml += fmt::format(
            "{}  <Topology TopologyType=\"Polyvertex\" NumberOfElements=\"{}\" NodesPerElement=\"1\"/>\n", in,
            arrays.front().rows);
        xml += fmt::format("{0}  <Geometry GeometryType=\"XYZ\">\n{1}{0}  </Geometry>\n", in,
                           reference(file, arrays.front(), frame, in + "    "));
        for (std::size_t a = 1; a < arrays.size(); ++a)
            xml += fmt::format(
                "{0}  <Attribute Name=\"{1}\" AttributeType=\"{2}\" Center=\"Node\">\n{3}{0}  </Attribute>\n",
                in, escaped(arrays[a].name), arrays[a].width > 1 ? "Vector" : "Scalar",
                reference(file, arrays[a], frame, in + "    "));
        xml += in + "</Grid>\n";
    }
    if (series)
        xml += "    </Grid>\n";
    return xml + "  </Domain>\n</Xdmf>\n";
}

std::string xdmf_surfaces(const std::string& hdf5_file, const std::vector<XdmfSurface>& surfaces) {
    const std::string file = std::filesystem::path(hdf5_file).filename().string(), in = "      ";
    std::string xml = "<?xml version=\"1.0\" ?>\n<Xdmf Version=\"2.0\">\n  <Domain>\n";
    for (const XdmfSurface& surface : surfaces) {
        xml += fmt::format("    <Grid Name=\"{}\" GridType=\"Uniform\">\n", escaped(surface.name));
        xml += fmt::format("{0}<Topology TopologyType=\"{1}\" NumberOfElements=\"{2}\">\n{3}{0}</Topology>\n",
                           in, surface.corners.width == 3 ? "Triangle" : "Quadrilateral",
                           surface.corners.rows, reference(file, surface.corners, 0, in + "  "));
        xml += fmt::format("{0}<Geometry GeometryType=\"XYZ\">\n{1}{0}</Geometry>\n", in,
                           reference(file, surface.points, 0, in + "  "));
        for (const XdmfArray& array : surface.cells)
            xml += fmt::format(
                "{0}<Attribute Name=\"{1}\" AttributeType=\"{2}\" Center=\"Cell\">\n{3}{0}</Attribute>\n", in,
                escaped(array.name), array.width > 1 ? "Vector" : "Scalar",
                reference(file, array, 0, in + "  "));
        xml += "    </Grid>\n";
    }
    return xml + "  </Domain>\n</Xdmf>\n";
}

} // namespace talus::io
