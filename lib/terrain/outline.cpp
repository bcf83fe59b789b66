// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/outline.hpp"

#include "base/error.hpp"
#include "terrain/gdal_session.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <limits>
#include <memory>
#include <ogrsf_frmts.h>
#include <utility>

namespace talus::terrain {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

[[noreturn]] void refuse(const std::string& name, const std::string& what) {
    throw Error(ExitCode::input_invalid, fmt::format("{}: {}", name, what));
}

double ring_area(const Outline::Ring& ring) {
    double twice = 0;
    for (std::size_t k = 0; k < ring.size(); ++k) {
        const Outline::Point& a = ring[k];
        const Outline::Point& b = ring[(k + 1) % ring.size()];
        // relative to the first point: map coordinates are large
        twice += (a[0] - ring[0][0]) * (b[1] - ring[0][1]) - (b[0] - ring[0][0]) * (a[1] - ring[0][1]);
    }
    return std::abs(twice) / 2;
}

template <class Visit>
void for_each_edge(const std::vector<Outline::Polygon>& polygons, Visit&& visit) {
    for (const Outline::Polygon& polygon : polygons)
        for (const Outline::Ring& ring : polygon)
            for (std::size_t k = 0; k < ring.size(); ++k)
                visit(ring[k], ring[k + 1 == ring.size() ? 0 : k + 1]);
}

} // namespace

Outline::Outline(std::vector<Polygon> polygons, std::string name)
    : polygons_(std::move(polygons)), bounds_{inf, inf, -inf, -inf}, name_(std::move(name)) {
    for (const Polygon& polygon : polygons_)
        for (const Ring& ring : polygon) {
            if (ring.size() < 3)
                refuse(name_, "a ring has fewer than three points; draw closed polygons");
            for (const Point& p : ring) {
                if (!std::isfinite(p[0]) || !std::isfinite(p[1]))
                    refuse(name_, "a coordinate is not a finite number; correct the outline");
                bounds_ = {std::min(bounds_.lower_x, p[0]), std::min(bounds_.lower_y, p[1]),
                           std::max(bounds_.upper_x, p[0]), std::max(bounds_.upper_y, p[1])};
            }
        }
    if (!polygons_.empty())
        fill_bins();
}

void Outline::fill_bins() {
    const double edge_x = bounds_.width() / bins_, edge_y = bounds_.height() / bins_;
    bin_reach_ = 0.5 * std::hypot(edge_x, edge_y) * (1 + 1e-9);
    bin_distance_.resize(static_cast<std::size_t>(bins_) * bins_);
    for (int row = 0; row < bins_; ++row)
        for (int column = 0; column < bins_; ++column) {
            const double x = bounds_.lower_x + (column + 0.5) * edge_x,
                         y = bounds_.lower_y + (row + 0.5) * edge_y;
            const double distance = distance_to_edges(x, y);
            bin_distance_[static_cast<std::size_t>(row * bins_ + column)] =
                contains_exactly(x, y) ? distance : -distance;
        }
}

double Outline::rough_distance(double x, double y) const {
    const auto bin = [](double place, double extent) {
        return std::clamp(static_cast<int>(place / extent * bins_), 0, bins_ - 1);
    };
    const int column = bin(x - bounds_.lower_x, bounds_.width()),
              row = bin(y - bounds_.lower_y, bounds_.height());
    return bin_distance_[static_cast<std::size_t>(row * bins_ + column)];
}

Outline Outline::from_rectangle(const Rectangle& r) {
    return Outline(
        {{{{r.lower_x, r.lower_y}, {r.upper_x, r.lower_y}, {r.upper_x, r.upper_y}, {r.lower_x, r.upper_y}}}},
        "domain");
}

double Outline::area() const {
    double sum = 0;
    for (const Polygon& polygon : polygons_)
        for (std::size_t k = 0; k < polygon.size(); ++k)
            sum += k == 0 ? ring_area(polygon[k]) : -ring_area(polygon[k]);
    return sum;
}

bool Outline::contains(double x, double y) const {
    if (!(x >= bounds_.lower_x && x <= bounds_.upper_x && y >= bounds_.lower_y && y <= bounds_.upper_y))
        return false;
    const double rough = rough_distance(x, y);
    return std::abs(rough) > bin_reach_ ? rough > 0 : contains_exactly(x, y);
}

bool Outline::near_edge(double x, double y, double distance) const {
    const bool within =
        x >= bounds_.lower_x && x <= bounds_.upper_x && y >= bounds_.lower_y && y <= bounds_.upper_y;
    if (within && std::abs(rough_distance(x, y)) - bin_reach_ > distance)
        return false;
    return distance_to_edges(x, y) < distance;
}

bool Outline::contains_exactly(double x, double y) const {
    for (const Polygon& polygon : polygons_) {
        bool inside = false; // even-odd over the rings of one polygon: holes are outside
        for (const Ring& ring : polygon)
            for (std::size_t k = 0; k < ring.size(); ++k) {
                const Point& a = ring[k];
                const Point& b = ring[k + 1 == ring.size() ? 0 : k + 1];
                if ((a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
                    inside = !inside;
            }
        if (inside)
            return true;
    }
    return false;
}

double Outline::distance_to_edges(double x, double y) const {
    double nearest = inf;
    for_each_edge(polygons_, [&](const Point& a, const Point& b) {
        const double ex = b[0] - a[0], ey = b[1] - a[1], px = x - a[0], py = y - a[1];
        const double length2 = ex * ex + ey * ey;
        const double s = length2 > 0 ? std::clamp((px * ex + py * ey) / length2, 0.0, 1.0) : 0.0;
        const double dx = px - s * ex, dy = py - s * ey;
        nearest = std::min(nearest, dx * dx + dy * dy);
    });
    return std::sqrt(nearest);
}

double Outline::signed_distance(double x, double y) const {
    return contains(x, y) ? distance_to_edges(x, y) : -distance_to_edges(x, y);
}

Placement Outline::place(const Rectangle& rectangle) const {
    const double slack = 1e-9 * (rectangle.width() + rectangle.height());
    const Rectangle r{rectangle.lower_x - slack, rectangle.lower_y - slack, rectangle.upper_x + slack,
                      rectangle.upper_y + slack};
    if (r.lower_x > bounds_.upper_x || r.upper_x < bounds_.lower_x || r.lower_y > bounds_.upper_y ||
        r.upper_y < bounds_.lower_y || empty())
        return Placement::outside;
    const double middle_x = (r.lower_x + r.upper_x) / 2, middle_y = (r.lower_y + r.upper_y) / 2;
    if (bounds_.contains(r)) {
        const double rough = rough_distance(middle_x, middle_y);
        if (std::abs(rough) > bin_reach_ + 0.5 * std::hypot(r.width(), r.height()))
            return rough > 0 ? Placement::inside : Placement::outside;
    }
    bool touched = false;
    for_each_edge(polygons_, [&](const Point& a, const Point& b) {
        if (touched)
            return;
        // clip the edge by the rectangle's slabs (Liang & Barsky)
        double enter = 0, leave = 1;
        const double start[2] = {a[0], a[1]}, step[2] = {b[0] - a[0], b[1] - a[1]};
        const double low[2] = {r.lower_x, r.lower_y}, high[2] = {r.upper_x, r.upper_y};
        for (int k = 0; k < 2; ++k) {
            if (step[k] == 0) {
                if (start[k] < low[k] || start[k] > high[k])
                    return;
                continue;
            }
            double t0 = (low[k] - start[k]) / step[k], t1 = (high[k] - start[k]) / step[k];
            if (t0 > t1)
                std::swap(t0, t1);
            enter = std::max(enter, t0);
            leave = std::min(leave, t1);
            if (enter > leave)
                return;
        }
        touched = true;
    });
    if (touched)
        return Placement::cut;
    return contains(middle_x, middle_y) ? Placement::inside : Placement::outside;
}

Outline Outline::relative_to(double x, double y) const {
    std::vector<Polygon> moved = polygons_;
    for (Polygon& polygon : moved)
        for (Ring& ring : polygon)
            for (Point& p : ring)
                p = {p[0] - x, p[1] - y};
    return Outline(std::move(moved), name_);
}

namespace {

Outline::Ring to_ring(const OGRLinearRing& source) {
    Outline::Ring ring;
    for (int k = 0; k < source.getNumPoints(); ++k) {
        const Outline::Point p{source.getX(k), source.getY(k)};
        if (ring.empty() || ring.back() != p)
            ring.push_back(p);
    }
    if (ring.size() > 1 && ring.front() == ring.back())
        ring.pop_back();
    return ring;
}

void add_polygons(const OGRGeometry& geometry, std::vector<Outline::Polygon>& polygons) {
    const OGRwkbGeometryType type = wkbFlatten(geometry.getGeometryType());
    if (type == wkbPolygon) {
        const OGRPolygon& polygon = *geometry.toPolygon();
        if (!polygon.getExteriorRing() || polygon.getExteriorRing()->IsEmpty())
            return;
        Outline::Polygon rings{to_ring(*polygon.getExteriorRing())};
        for (int k = 0; k < polygon.getNumInteriorRings(); ++k)
            rings.push_back(to_ring(*polygon.getInteriorRing(k)));
        polygons.push_back(std::move(rings));
    } else if (type == wkbMultiPolygon || type == wkbGeometryCollection) {
        const OGRGeometryCollection& collection = *geometry.toGeometryCollection();
        for (int k = 0; k < collection.getNumGeometries(); ++k)
            add_polygons(*collection.getGeometryRef(k), polygons);
    }
}

/// The transformation into the target's system, or none where the coordinates are taken as they are.
std::unique_ptr<OGRCoordinateTransformation> transformation_into(const std::string& target_wkt,
                                                                 OGRLayer& layer, const std::string& path) {
    const OGRSpatialReference* stated = layer.GetSpatialRef();
    if (!stated)
        return nullptr;
    OGRSpatialReference source(*stated), target;
    if (source.IsGeographic()) {
        OGREnvelope extent;
        if (layer.GetExtent(&extent) == OGRERR_NONE &&
            (extent.MinX < -360 || extent.MaxX > 360 || extent.MinY < -90 || extent.MaxY > 90))
            return nullptr; // cannot be degrees: a GeoJSON in projected metres that does not say so
        if (target_wkt.empty())
            refuse(
                path,
                "is in degrees and the rasters state no coordinate system to bring it to; reproject it with "
                "'ogr2ogr -t_srs', or put a .prj beside the rasters");
    }
    if (target_wkt.empty())
        return nullptr;
    if (target.importFromWkt(target_wkt.c_str()) != OGRERR_NONE)
        refuse(path, "the rasters' coordinate system cannot be read; check their .prj");
    source.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    target.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    const char* const options[] = {"CRITERION=EQUIVALENT", nullptr};
    if (source.IsSame(&target, options))
        return nullptr;
    std::unique_ptr<OGRCoordinateTransformation> result(OGRCreateCoordinateTransformation(&source, &target));
    if (!result)
        refuse(path, fmt::format("cannot be brought from {} to {} ({})",
                                 stated->GetName() ? stated->GetName() : "an unnamed system",
                                 system_name(target_wkt), last_gdal_message()));
    return result;
}

} // namespace

Outline read_outline(const std::string& path, const std::string& target_wkt) {
    start_gdal();
    if (!std::filesystem::exists(path))
        refuse(path, "no such file; give a GeoJSON or shapefile with polygons");
    const std::unique_ptr<GDALDataset> dataset(
        GDALDataset::Open(path.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY));
    if (!dataset)
        refuse(path, fmt::format("not an outline that OGR reads ({}); give a GeoJSON or shapefile",
                                 last_gdal_message()));
    std::vector<Outline::Polygon> polygons;
    for (int l = 0; l < dataset->GetLayerCount(); ++l) {
        OGRLayer* layer = dataset->GetLayer(l);
        const auto transformation = transformation_into(target_wkt, *layer, path);
        layer->ResetReading();
        while (const OGRFeatureUniquePtr feature{layer->GetNextFeature()}) {
            OGRGeometry* geometry = feature->GetGeometryRef();
            if (!geometry)
                continue;
            CPLErrorReset();
            if (!geometry->IsValid())
                refuse(path,
                       fmt::format("feature {}: not a valid area ({}); repair it, for example with 'ogr2ogr "
                                   "-makevalid'",
                                   feature->GetFID(), last_gdal_message()));
            if (transformation && geometry->transform(transformation.get()) != OGRERR_NONE)
                refuse(path, fmt::format("feature {}: cannot be reprojected ({})", feature->GetFID(),
                                         last_gdal_message()));
            add_polygons(*geometry, polygons);
        }
    }
    if (polygons.empty())
        refuse(path, "holds no polygon; give an area, not points or lines");
    return Outline(std::move(polygons), path);
}

Outline read_domain(const std::string& rectangle_or_path, const std::string& target_wkt) {
    double value[4];
    const char* at = rectangle_or_path.data();
    const char* const end = at + rectangle_or_path.size();
    for (int k = 0; k < 4; ++k) {
        const auto [rest, error] = std::from_chars(at, end, value[k]);
        const bool last = k == 3;
        if (error != std::errc{} || (last ? rest != end : rest == end || *rest != ','))
            return read_outline(rectangle_or_path, target_wkt);
        at = rest + !last;
    }
    const Rectangle rectangle{value[0], value[1], value[2], value[3]};
    for (double v : value)
        if (!std::isfinite(v) || rectangle.empty())
            throw Error(
                ExitCode::configuration_invalid,
                fmt::format("domain: {} found, xmin,ymin,xmax,ymax with xmin < xmax and ymin < ymax expected",
                            rectangle_or_path));
    return Outline::from_rectangle(rectangle);
}

} // namespace talus::terrain
