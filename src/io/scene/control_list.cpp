#include "io/scene/control_list.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "io/files/read_file.h"

namespace tvsgs {
namespace {

/// Value of a parameter such as "+units="; empty: none.
std::string parameter(const std::string& proj, const std::string& key) {
    const std::size_t at = proj.find(key);
    if (at == std::string::npos) return "";
    std::string_view rest = std::string_view(proj).substr(at + key.size());
    return std::string(next_word(rest));
}

/// EPSG code of "WGS84 UTM 32N"; empty: the text is something else.
std::string utm_code(const std::string& words) {
    constexpr std::string_view kBegin = "wgs84 utm ";
    if (!words.starts_with(kBegin)) return "";
    std::string zone = words.substr(kBegin.size());
    std::erase(zone, ' ');
    const char side = zone.empty() ? ' ' : zone.back();
    int number = 0;
    if ((side != 'n' && side != 's') ||
        !parse_number(std::string_view(zone).substr(0, zone.size() - 1), number) || number < 1 ||
        number > 60)
        return "";
    return str("EPSG:", (side == 'n' ? 32600 : 32700) + number);
}

class ListReader {
public:
    explicit ListReader(const std::string& path) { list_.path = path; }

    ControlList read() {
        const std::string text = read_text(list_.path, kMaxTextBytes);
        bool has_projection = false;
        for (std::string_view rest = text; !rest.empty();) {
            ++line_;
            const std::string_view words = trimmed(next_line(rest));
            if (words.empty() || words.front() == '#') continue;
            if (has_projection)
                add_mark(words);
            else
                read_projection(words), has_projection = true;
        }
        require_metres();
        if (list_.points.empty())
            throw input_error(list_.path, ": has no control points; expected a line with the ",
                              "projection, then lines \"x y z px py image [name]\"");
        return std::move(list_);
    }

private:
    template <class... Parts>
    Error wrong(const Parts&... what) const {
        return input_error(list_.path, ":", line_, ": ", what...);
    }

    /// Many systems have degrees: EPSG:4258, 4269, 7844 and others. UTM has metres.
    void require_metres() const {
        const auto in_degrees = [](const ControlPoint& point) {
            return std::abs(point.position.x) <= 180 && std::abs(point.position.y) <= 180;
        };
        if (list_.degrees || !list_.projection.starts_with("EPSG:") ||
            list_.projection.starts_with("EPSG:326") || list_.projection.starts_with("EPSG:327") ||
            list_.points.empty() || !std::ranges::all_of(list_.points, in_degrees))
            return;
        throw input_error(list_.path, ": all x and y are within 180 in ", list_.projection,
                          ", so they seem to be degrees; expected metres, or longitude and "
                          "latitude in EPSG:4326");
    }

    void read_projection(std::string_view line) {
        const std::string words = lower_case(line);
        int code = 0;
        if (words.starts_with("epsg:") && parse_number(words.substr(5), code) && code > 0) {
            list_.projection = str("EPSG:", code);
            list_.degrees = code == 4326 || code == 4979;
        } else if (words.find("+proj=") != std::string::npos) {
            list_.projection = line;
            const std::string proj = parameter(words, "+proj="),
                              units = parameter(words, "+units=");
            list_.degrees =
                proj == "longlat" || proj == "latlong" || proj == "lonlat" || proj == "latlon";
            const std::string to_metre = parameter(words, "+to_meter=");
            if ((!units.empty() && units != "m") || (!to_metre.empty() && to_metre != "1"))
                throw wrong("the unit is '", shown(units.empty() ? to_metre + " m" : units),
                            "'; expected metres: convert the coordinates");
        } else if (const std::string utm = utm_code(words); !utm.empty()) {
            list_.projection = utm;
        } else {
            throw wrong("'", shown(line),
                        "' is no projection; expected EPSG:32632, a PROJ string (+proj=...) or "
                        "WGS84 UTM 32N in the first line");
        }
    }

    void add_mark(std::string_view line) {
        std::vector<std::string_view> words;
        for (std::string_view rest = line, word; !(word = next_word(rest)).empty();)
            words.push_back(word);
        if (words.size() < 6)
            throw wrong(words.size(), " columns; expected \"x y z px py image [name]\"");
        const auto number = [&](std::size_t column) {
            constexpr const char* kNames[] = {"x", "y", "z", "px", "py"};
            double value = 0;
            // Farther than 1e9 the readers of scenes refuse poses.
            if (!parse_number(words[column], value) || !(std::abs(value) <= 1e9))
                throw wrong(kNames[column], " is '", shown(words[column]),
                            "'; expected a number within 1e9");
            return value;
        };
        const Vec3d position{number(0), number(1), number(2)};
        if (list_.degrees && !(std::abs(position.x) <= 180 && std::abs(position.y) <= 90))
            throw wrong(position.x, " ", position.y, " is no place in ", list_.projection,
                        "; expected longitude and latitude in degrees");
        ControlMark mark{std::string(words[5]), {number(3), number(4)}, line_};
        const std::string name(words.size() > 6 ? words[6] : "");
        point_of(name, position).marks.push_back(std::move(mark));
    }

    ControlPoint& point_of(const std::string& name, Vec3d at) {
        const auto key =
            name.empty() ? std::tuple(name, at.x, at.y, at.z) : std::tuple(name, 0.0, 0.0, 0.0);
        const auto [entry, is_new] = index_of_.try_emplace(key, list_.points.size());
        if (is_new) {
            list_.points.push_back({name.empty() ? str("line ", line_) : name, at, {}});
            return list_.points.back();
        }
        ControlPoint& point = list_.points[entry->second];
        if (norm(point.position - at) > 0)
            throw wrong("'", shown(name), "' has other coordinates than in line ",
                        point.marks[0].line, "; expected one position for each name");
        return point;
    }

    ControlList list_;
    std::map<std::tuple<std::string, double, double, double>, std::size_t> index_of_;
    int line_ = 0;
};

}  // namespace

ControlList read_control_list(const std::string& path) {
    return ListReader(path).read();
}

}  // namespace tvsgs
