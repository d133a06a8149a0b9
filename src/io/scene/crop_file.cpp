#include "io/scene/crop_file.h"

#include <cmath>

#include "io/files/json_value.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

/// Reads values of one file. Each error names the file.
struct CropReader {
    std::string path;

    template <class... Parts>
    Error wrong(const Parts&... what) const {
        return input_error(path, ": crop: ", what...);
    }

    const JsonValue& at(const JsonValue& object, const char* key) const {
        if (!object[key]) throw wrong("key '", key, "' is missing");
        return object[key];
    }
    double number(const JsonValue& value, const std::string& name) const {
        const double v = value.number_or(std::nan(""));
        if (!std::isfinite(v))
            throw wrong(name, " is ", json_text(value), ", expected a finite number");
        return v;
    }
    Vec3d point(const JsonValue& value, const std::string& name) const {
        const std::vector<JsonValue>& v = value.items;
        if (v.size() != 3) throw wrong(name, " is ", json_text(value), ", expected [x, y, z]");
        return {number(v[0], name), number(v[1], name), number(v[2], name)};
    }
    void require_order(double min, double max, const std::string& name) const {
        if (!(min <= max))
            throw wrong(name, ": the lower bound ", min, " is above the upper bound ", max);
    }

    Crop prism(const JsonValue& file) const {
        Crop crop;
        crop.kind = Crop::Kind::prism;
        if (const JsonValue& name = at(file, "class_name"); name.text != "SelectionPolygonVolume")
            throw wrong("class_name is ", json_text(name), ", expected SelectionPolygonVolume");
        const JsonValue& given = file["orthogonal_axis"];
        const std::string axis = given ? given.text : "Z";
        if (axis != "X" && axis != "Y" && axis != "Z")
            throw wrong("orthogonal_axis is ", json_text(given), ", expected X, Y or Z");
        crop.axis = axis[0] - 'X';
        crop.axis_min = number(at(file, "axis_min"), "axis_min");
        crop.axis_max = number(at(file, "axis_max"), "axis_max");
        require_order(crop.axis_min, crop.axis_max, "axis_min, axis_max");
        for (const JsonValue& corner : at(file, "bounding_polygon").items)
            crop.polygon.push_back(point(corner, "bounding_polygon"));
        if (crop.polygon.size() < 3) throw wrong("bounding_polygon has fewer than 3 corners");
        return crop;
    }
    Crop box(const JsonValue& value) const {
        Crop crop;
        crop.kind = Crop::Kind::box;
        if (value.items.size() != 2)
            throw wrong("box is ", json_text(value), ", expected two corners");
        crop.min = point(value.items[0], "box"), crop.max = point(value.items[1], "box");
        for (int axis = 0; axis < 3; ++axis) require_order(crop.min[axis], crop.max[axis], "box");
        return crop;
    }
    Crop cylinder(const JsonValue& value) const {
        Crop crop;
        crop.kind = Crop::Kind::cylinder;
        const std::vector<JsonValue>& center = at(value, "center_xy").items;
        if (center.size() != 2)
            throw wrong("center_xy is ", json_text(value["center_xy"]), ", expected [x, y]");
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
    const JsonValue file = parse_json_value(read_bytes(path), path + ": crop");
    if (!file.is(JsonValue::Kind::object)) throw reader.wrong("not a JSON object");
    if (file["box"]) return reader.box(file["box"]);
    if (file["crop_cylinder"]) return reader.cylinder(file["crop_cylinder"]);
    if (file["class_name"]) return reader.prism(file);
    throw reader.wrong(
        "expected \"box\", \"crop_cylinder\" or a Tanks-and-Temples selection volume "
        "(\"class_name\")");
}

}  // namespace tvsgs
