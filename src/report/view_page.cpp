#include "report/view_page.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/device/parallel_lists.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/version.h"
#include "io/images/image_file.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/fuse/focus.h"
#include "render/backbone.h"
#include "render/depth/map_images.h"
#include "render/tiles/blend_math.h"
#include "report/page.h"
#include "report/page_data.h"
#include "report/plot.h"

namespace tvsgs {
namespace {

constexpr int kPhotoSide = 640, kPosterSide = 800;  // px
constexpr std::size_t kPhotoBytes = 3'000'000;      // of all photographs
constexpr std::size_t kPageBytes = 200'000;         // of texts, scripts and posters, approximately
constexpr std::size_t kTextureShare = 5;            // a fifth of the page, for textures
constexpr double kBase64 = 4.0 / 3;                 // bytes of text for one of data

/// Replaces each {{name}} in the template; `values` must have all names.
std::string filled(const std::string& text, const std::map<std::string, std::string>& values) {
    std::string out;
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t open = text.find("{{", at), close = text.find("}}", open);
        out.append(text, at, open == std::string::npos ? open : open - at);
        if (open == std::string::npos) break;
        out += values.at(text.substr(open + 2, close - open - 2));
        at = close + 2;
    }
    return out;
}

/// Width and height with a longer side of at most `side`.
std::pair<int, int> at_most(int width, int height, int side) {
    const double scale = std::min(1.0, static_cast<double>(side) / std::max(width, height));
    const auto scaled = [&](int n) {
        return std::max(1, static_cast<int>(std::lround(n * scale)));
    };
    return {scaled(width), scaled(height)};
}

std::string jpeg_source(const std::string& bytes) {
    return "data:image/jpeg;base64," + base64(bytes);
}

/// Data URIs per camera: at most `count` photographs, evenly spaced among the cameras that have
/// one, within kPhotoBytes. Empty: not shown.
std::vector<std::string> photographs(const std::vector<ViewCamera>& cameras, int count) {
    std::vector<std::size_t> with;
    for (std::size_t i = 0; i < cameras.size(); ++i)
        if (!cameras[i].photo.empty()) with.push_back(i);
    const std::size_t n = with.size(), kept = std::min(n, static_cast<std::size_t>(count));
    std::vector<std::string> jpegs(cameras.size());
    for (int side = kPhotoSide; kept > 0;) {
        parallel_for_throwing(static_cast<int>(kept), [&](int index) {
            const auto k = static_cast<std::size_t>(index);
            const std::size_t i = with[kept < 2 ? 0 : k * (n - 1) / (kept - 1)];
            const ImageU8& photo = cameras[i].photo;
            const auto [width, height] = at_most(photo.width, photo.height, side);
            jpegs[i] = jpeg_bytes(resize_bicubic(photo, width, height), 80);
        });
        std::size_t bytes = 0;
        for (const std::string& jpeg : jpegs) bytes += jpeg.size();
        if (bytes <= kPhotoBytes || side <= 64) break;
        side = static_cast<int>(
            0.95 * side * std::sqrt(static_cast<double>(kPhotoBytes) / static_cast<double>(bytes)));
    }
    return jpegs;
}

JsonValue list_of(Vec3d v) {
    return std::vector<double>{v.x, v.y, v.z};
}

/// Centre of rotation and reference sizes of the scene.
JsonValue scene_json(const std::vector<ViewCamera>& cameras, const std::vector<ViewRun>& runs) {
    std::vector<Camera> all;
    for (const ViewCamera& c : cameras) all.push_back(c.camera);
    const Mat3<double> upright = upright_from_scene(all);
    Focus focus{vec_cast<double>(camera_centre(all.front())), 1};
    if (const auto found = find_focus(all)) {
        focus = *found;
    } else if (runs.front().splats.size() > 0) {  // one camera, or all look the same way
        std::vector<Vec3f> means = to_host(runs.front().splats.means);
        const auto depth = [&](Vec3f p) { return (all.front().camera_from_world * p).z; };
        std::nth_element(means.begin(),
                         means.begin() + static_cast<std::ptrdiff_t>(means.size() / 2), means.end(),
                         [&](Vec3f a, Vec3f b) { return depth(a) < depth(b); });
        const double z = static_cast<double>(depth(means[means.size() / 2]));
        if (z > 0) focus = focus_at_depth(all, z);
    }
    if (!(focus.radius > 1e-6 * norm(focus.point)) || !(focus.radius > 0)) focus.radius = 1;
    return JsonValue()
        .add("middle", list_of(focus.point))
        .add("radius", focus.radius)
        .add("up", list_of({upright[1][0], upright[1][1], upright[1][2]}));
}

JsonValue camera_json(const ViewCamera& c, bool has_photo) {
    const Mat3<double> R = mat_cast<double>(c.camera.camera_from_world.R);
    const Vec3d centre = -transpose_times(R, vec_cast<double>(c.camera.camera_from_world.t));
    JsonValue rows = JsonValue::list();
    for (int r = 0; r < 3; ++r) rows.items.push_back(list_of({R[r][0], R[r][1], R[r][2]}));
    return JsonValue()
        .add("name", c.name)
        .add("test", c.test ? 1.0 : 0.0)
        .add("photo", has_photo ? 1.0 : 0.0)
        .add("rows", std::move(rows))
        .add("centre", list_of(centre))
        .add("fx", c.camera.fx_px)
        .add("fy", c.camera.fy_px)
        .add("cx", c.camera.cx_px)
        .add("cy", c.camera.cy_px)
        .add("width", c.camera.width_px)
        .add("height", c.camera.height_px);
}

/// Picture that replaces the view in browsers without WebGL, and until the view has loaded.
ImageU8 poster(Backbone<Cpu>& backbone, const Gaussians<Cpu>& splats, const Camera& camera) {
    const auto [width, height] = at_most(camera.width_px, camera.height_px, kPosterSide);
    const Camera small = scaled_camera(camera, width, height);
    if (splats.size() == 0) return ImageU8(small.width_px, small.height_px, 3);
    const auto& images = backbone.forward(splats, small, splats.sh_degree, Maps::color);
    return color_image(images.width, images.height, to_host(images.color));
}

std::string hold(const char* id, std::size_t index, const std::string& base64_text) {
    return str("<script type=\"application/octet-stream\" id=\"", id, index, "\">", base64_text,
               "</script>\n");
}

/// Builds a page step by step.
class Builder {
public:
    Builder(ViewSubject subject, const ViewPageOptions& options)
        : subject_(std::move(subject)), options_(options) {}

    ViewPage build() {
        add_cameras();
        for (const ViewRun& run : runs_)
            if (run.truth && full_ == 0) full_ = full_error(*run.truth);
        for (std::size_t i = 0; i < runs_.size(); ++i) add_mesh(i);
        // Room for splats: the rest of the page, and at least a tenth of it beside large meshes.
        const std::size_t others = data_.size() + cameras_html_.size() + kPageBytes;
        const std::size_t room = std::max(
            options_.max_bytes / 10, options_.max_bytes > others ? options_.max_bytes - others : 0);
        for (std::size_t i = 0; i < runs_.size(); ++i)
            add_splats(
                i, static_cast<std::size_t>(static_cast<double>(room / runs_.size()) / kBase64));
        add_plots();
        add_table();
        return {html(), poster_, notes_};
    }

private:
    std::size_t start() const { return cameras_.size() / 2; }

    void note(const std::string& text) { notes_.push_back(text); }

    void add_cameras() {
        const std::vector<std::string> jpegs = photographs(cameras_, options_.max_photos);
        std::string items;
        std::size_t shown = 0, there = 0;
        bool any_test = false;
        JsonValue list = JsonValue::list();
        for (std::size_t i = 0; i < cameras_.size(); ++i) {
            const ViewCamera& c = cameras_[i];
            const bool has = !jpegs[i].empty();
            shown += has, there += !c.photo.empty(), any_test = any_test || c.test;
            list.items.push_back(camera_json(c, has));
            items += str("<li><button type=\"button\" data-camera=\"", i, "\">");
            if (has)
                items +=
                    str("<img id=\"photo", i, "\" alt=\"\" src=\"", jpeg_source(jpegs[i]), "\">");
            items +=
                str("<span>", escaped(c.name), c.test ? " (test)" : "", "</span></button></li>\n");
        }
        has_photos_ = shown > 0;
        if (shown < there)
            note(str("Photographs: ", shown, " of ", there, ", evenly spaced."));
        else if (shown == 0)
            note("This page has no photographs.");
        about_.add("cameras", std::move(list))
            .add("start", start())
            .add("scene", scene_json(cameras_, runs_));
        cameras_html_ = str("<h2 id=\"cameras\">Cameras</h2>\n<ul class=\"cameras\">\n", items,
                            "</ul>\n<p><span class=\"legend\"></span>training",
                            any_test ? " <span class=\"legend test\"></span>test" : "",
                            " <span class=\"legend chosen\"></span>chosen</p>\n");
    }

    void add_mesh(std::size_t i) {
        ViewRun& run = runs_[i];
        JsonValue about;
        if (!run.mesh.faces.empty()) {
            if (!run.texture.image.empty()) {
                const std::size_t bytes = options_.max_bytes / kTextureShare / runs_.size();
                data_ += hold("texture", i, base64(texture_for_page(run.texture.image, bytes)));
                split_at_charts(run.mesh, run.texture);
            }
            std::vector<std::uint8_t> errors;
            const std::vector<Vec3f>& v = run.mesh.vertices;
            if (run.truth) errors = error_levels({v.data(), v.size()}, *run.truth, full_);
            PackedMesh packed = pack_mesh(run.mesh, errors, run.texture.places);
            about.add("mesh", std::move(packed.about));
            data_ += hold("mesh", i, base64(packed.data));
            if (run.mesh.faces.size() < run.mesh_faces)
                note(str(run.name, ": mesh simplified from ", grouped(run.mesh_faces), " to ",
                         grouped(run.mesh.faces.size()),
                         " triangles for this page, in the colours of its vertices."));
        }
        abouts_.push_back(std::move(about));
    }

    void add_splats(std::size_t i, std::size_t max_bytes) {
        ViewRun& run = runs_[i];
        JsonValue& about = abouts_[i];
        const auto backbone = make_backbone<Cpu>(run.train.backbone, run.train.render);
        const auto all = static_cast<std::size_t>(run.splats.size());
        PackedSplats packed = pack_splats(std::move(run.splats), max_bytes, options_.max_splats);
        const auto count = static_cast<std::size_t>(packed.shown.size());
        if (packed.shown.size() < packed.of)
            note(str(run.name, ": the ", grouped(count), " largest of ",
                     grouped(static_cast<std::size_t>(packed.of)),
                     packed.shown.size() == options_.max_splats
                         ? " splats (--max-splats)."
                         : " splats, to limit the page size (--megabytes)."));
        if (count > 0 && packed.shown.sh_degree < packed.of_degree)
            note(str(run.name, ": SH degree ", packed.shown.sh_degree, " instead of ",
                     packed.of_degree, ", to limit the page size (--megabytes)."));
        about.add("name", run.name)
            .add("splats", count)
            .add("discs", backbone->traits.flat ? 1.0 : 0.0)
            .add("near", run.train.render.near)
            .add("low_pass", backbone->traits.low_pass_px2)
            .add("least_alpha", kMinAlpha)
            .add("truth", run.truth ? 1.0 : 0.0);
        if (count > 0) {
            data_ += hold("splats", i, base64({packed.bytes.begin(), packed.bytes.end()}));
            if (run.truth) {
                const auto levels = error_levels(packed.shown.means.span(), *run.truth, full_);
                data_ += hold("errors", i, base64(deflated({levels.begin(), levels.end()})));
            }
        }
        const ImageU8 picture = poster(*backbone, packed.shown, cameras_[start()].camera);
        const std::string source = jpeg_source(jpeg_bytes(picture, 80));
        if (i == 0) poster_ = source;
        panes_ += str("<img class=\"poster\" alt=\"", escaped(run.name), " as camera ",
                      escaped(cameras_[start()].name), " sees it\" src=\"", source, "\">\n");
        overlays_ +=
            str("<div class=\"pane\" hidden><img alt=\"\" src=\"data:,\" hidden><canvas></canvas>",
                runs_.size() > 1 ? str("<span>", escaped(run.name), "</span>") : "", "</div>\n");
        rows_.push_back(
            {run.name,
             grouped(count) + (static_cast<std::size_t>(packed.of) < all
                                   ? str(" of ", grouped(all), "; opacity below 1/255 is invisible")
                                   : ""),
             std::to_string(packed.shown.sh_degree), backbone->traits.flat ? "discs" : "ellipsoids",
             run.mesh.faces.empty() ? "none"
                                    : grouped(run.mesh.faces.size()) +
                                          (run.texture.image.empty() ? " triangles, no texture"
                                                                     : " triangles, with texture"),
             run.truth ? "known" : "not given"});
    }

    void add_plots() {
        std::string plots;
        std::size_t id = 0;
        for (const ViewRun& run : runs_) {
            std::string own;
            for (const Plot& plot : plots_over_time(run.evaluations))
                own += plot_figure(plot, str("plot", ++id), "report.json");
            if (own.empty()) continue;
            if (runs_.size() > 1) plots += str("<h3>", escaped(run.name), "</h3>\n");
            plots += "<div class=\"plots\">\n" + own + "</div>\n";
        }
        if (!plots.empty()) parts_ += "<h2 id=\"time\">Error against time</h2>\n" + plots;
    }

    void add_table() {
        parts_ += "<h2 id=\"about-page\">About this page</h2>\n" +
                  html_table("Runs on this page",
                             {"run", "splats", "SH degree", "drawn as", "mesh", "truth"}, rows_);
    }

    /// Radio buttons: one of them is shown.
    std::string modes() const {
        const bool mesh =
            std::ranges::any_of(runs_, [](const ViewRun& r) { return !r.mesh.faces.empty(); });
        std::string text;
        const auto add = [&](const char* name, const char* label, const char* key) {
            text += str("<label><input type=\"radio\" name=\"mode\" value=\"", name,
                        "\" data-key=\"", key, "\"", text.empty() ? " checked" : "", "><span>",
                        label, "</span><kbd aria-hidden=\"true\">", key, "</kbd></label>");
        };
        add("splats", "Splats", "s");
        add("centres", "Centres", "c");
        if (mesh) {
            add("mesh", "Mesh", "m");
            add("grey", "Grey mesh", "g");
            add("normals", "Normals", "n");
            add("wires", "Wires", "w");
        }
        if (full_ > 0 && mesh) add("error", "Mesh error", "e");
        if (full_ > 0) add("centre-error", "Centre error", "x");
        return text;
    }

    std::string layers() const {
        const auto button = [](const char* name, const char* label, const char* key) {
            return str("<button type=\"button\" data-show=\"", name, "\" data-keys=\"", key,
                       "\" aria-pressed=\"true\" aria-keyshortcuts=\"", key, "\">", label,
                       "<kbd aria-hidden=\"true\">", key, "</kbd></button>");
        };
        return button("cameras", "Cameras", "f") +
               (has_photos_ ? button("photo", "Photograph", "p") : "");
    }

    std::string html() {
        std::string title, summary;
        for (std::size_t i = 0; i < runs_.size(); ++i) {
            title += (i ? " beside " : "") + runs_[i].name;
            if (abouts_[i]["splats"].number == 0 && options_.follow) continue;  // the page counts
            summary +=
                str(grouped(static_cast<std::size_t>(abouts_[i]["splats"].number)), " splats",
                    runs_.size() > 1 ? " of " : "", runs_.size() > 1 ? runs_[i].name : "", "; ");
        }
        std::string palette;
        for (int i = 0; i < 256; ++i) {
            const Rgb c = error_shade(static_cast<double>(i) / kErrorLevels);
            for (const std::uint8_t channel : {c.r, c.g, c.b})
                palette += static_cast<char>(channel);
        }
        about_.add("origin", list_of(subject_.origin))
            .add("unit", subject_.metres ? "metres" : "units")
            .add("follow", options_.follow ? 1.0 : 0.0)
            .add("runs", abouts_)
            .add("palette", base64(palette));
        std::string notes;
        for (const std::string& text : notes_)
            notes += "<p class=\"notice\">" + escaped(text) + "</p>\n";
        return filled(
            kViewPage,
            {{"policy", str(kViewPolicy, options_.follow ? "; connect-src 'self'" : "")},
             {"title", escaped(title) + ": view"},
             {"style", str(kPlotStyle, kPageStyle, kViewStyle)},
             {"heading", escaped(title)},
             {"summary", escaped(str(summary, counted(cameras_.size(), "camera"), "."))},
             {"notes", notes},
             {"view", escaped(str("View in 3D of ", title, "."))},
             {"panes", panes_ + overlays_},
             {"modes", modes()},
             {"layers", layers()},
             {"photo", has_photos_ ? "<label>Opacity <input id=\"opacity\" type=\"range\" "
                                     "min=\"0\" max=\"100\" value=\"50\"></label>"
                                   : ""},
             {"cameras", cameras_html_},
             {"scale", full_ > 0
                           ? str("<div id=\"scale\" hidden><p>Distance to the true surface, "
                                 "in ",
                                 subject_.metres ? "metres" : "scene units",
                                 ". Grey: not measured.</p>\n", error_scale(full_), "</div>\n")
                           : ""},
             {"parts", parts_},
             {"version", escaped(kVersion)},
             {"about", json_for_page(about_)},
             {"data", data_},
             {"script", kViewScript}});
    }

    ViewSubject subject_;
    std::vector<ViewRun>& runs_ = subject_.runs;
    const std::vector<ViewCamera>& cameras_ = subject_.cameras;
    const ViewPageOptions& options_;
    JsonValue about_;
    std::vector<JsonValue> abouts_;  // of the runs
    std::vector<std::vector<std::string>> rows_;
    std::string poster_, panes_, overlays_, cameras_html_, parts_, data_;
    std::vector<std::string> notes_;
    double full_ = 0;  // end of the error colour scale; 0: no truth
    bool has_photos_ = false;
};

}  // namespace

ViewPage view_page(ViewSubject subject, const ViewPageOptions& options) {
    return Builder(std::move(subject), options).build();
}

}  // namespace tvsgs
