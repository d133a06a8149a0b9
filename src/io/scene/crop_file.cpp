#include "io/scene/crop_file.h"

#include <cmath>

#include "io/files/json_file.h"

namespace tvsgs {
namespace {

using nlohmann::json;

/// Reads values of one file. Each error names the file.
struct CropReader {
    std::string path;

    template <class... Parts>
    Error wrong(const Parts&... what) const {
        return input_error(path, ": crop: ", what...);
    }

    const json& at(const json& object, const char* key) const {
        if (!object.is_object() || !object.contains(key)) throw wrong("key '", key, "' is missing");
        return object[key];
    }
    double number(const json& value, const std::string& name) const {
        const double v = value.is_number() ? value.get<double>() : std::nan("");
        if (!std::isfinite(v))
            throw wrong(name, " is ", value.dump(), ", expected a finite number");
        return v;
    }
    Vec3d point(const json& value, const std::string& name) const {
        if (!value.is_array() || value.size() != 3)
            throw wrong(name, " is ", value.dump(), ", expected [x, y, z]");
        return {number(value[0], name), number(value[1], name), number(value[2], name)};
    }
    void require_order(double min, double max, const std::string& name) const {
        if (!(min <= max))
            throw wrong(name, ": the lower bound ", min, " is above the upper bound ", max);
    }

    Crop prism(const json& file) const {
        Crop crop;
        crop.kind = Crop::Kind::prism;
        if (const json& name = at(file, "class_name"); name != "SelectionPolygonVolume")
            throw wrong("class_name is ", name.dump(), ", expected SelectionPolygonVolume");
        const std::string axis = file.value("orthogonal_axis", std::string("Z"));
        if (axis != "X" && axis != "Y" && axis != "Z")
            throw wrong("orthogonal_axis is ", axis, ", expected X, Y or Z");
        crop.axis = axis[0] - 'X';
        crop.axis_min = number(at(file, "axis_min"), "axis_min");
        crop.axis_max = number(at(file, "axis_max"), "axis_max");
        require_order(crop.axis_min, crop.axis_max, "axis_min, axis_max");
        for (const json& corner : at(file, "bounding_polygon"))
            crop.polygon.push_back(point(corner, "bounding_polygon"));
        if (crop.polygon.size() < 3) throw wrong("bounding_polygon has fewer than 3 corners");
        return crop;
    }
    Crop box(const json& value) const {
        Crop crop;
        crop.kind = Crop::Kind::box;
        if (!value.is_array() || value.size() != 2)
            throw wrong("box is ", value.dump(), ", expected two corners");
        crop.min = point(value[0], "box"), crop.max = point(value[1], "box");
        for (int axis = 0; axis < 3; ++axis) require_order(crop.min[axis], crop.max[axis], "box");
        return crop;
    }
    Crop cylinder(const json& value) const {
        Crop crop;
        crop.kind = Crop::Kind::cylinder;
        const json& center = at(value, "center_xy");
        if (!center.is_array() || center.size() != 2)
            throw wrong("center_xy is ", center.dump(), ", expected [x, y]");
        crop.center_x = number(center[0], "center_xy"),
        crop.center_y = number(center[1], "center_xy");
        crop.radius = number(at(value, "radius"), "radius");
        crop.min.z = number(at(value, "z_min"), "z_min"),
        crop.max.z = number(at(value, "z_max"), "z_max");
        require_order(0, crop.radius, "radius");
        require_order(crop.min.z, crop.max.z, "z_min, z_max");
        return crop;
    }
};

}  // namespace

Crop read_crop(const std::string& path) {
    const CropReader reader{path};
    const json file = read_json_file(path);
    if (!file.is_object()) throw reader.wrong("not a JSON object");
    try {
        if (file.contains("box")) return reader.box(file["box"]);
        if (file.contains("crop_cylinder")) return reader.cylinder(file["crop_cylinder"]);
        if (file.contains("class_name")) return reader.prism(file);
    } catch (const json::exception& error) {
        throw reader.wrong(error.what());
    }
    throw reader.wrong(
        "expected \"box\", \"crop_cylinder\" or a Tanks-and-Temples selection volume "
        "(\"class_name\")");
}

}  // namespace tvsgs
