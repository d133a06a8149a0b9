#include <algorithm>
#include <array>
#include <cmath>

#include "core/error.h"
#include "core/grouped.h"
#include "pipeline/run/train_evaluation.h"
#include "plan/look.h"
#include "report/plot.h"
#include "report/report.h"

namespace tvsgs {
namespace {

// Where a level begins. Conventions, not laws; the page says them beside what it calls so.
constexpr double kGoodF1 = 0.8, kFairF1 = 0.5;  // at the middle threshold
constexpr double kMuchSingleView = 0.25;        // share of what is shown, seen by one view only
constexpr double kFewShared = 0.2;              // share of a view that its best partner sees
constexpr double kWideGapDeg = 30;              // between neighbours; stereo weakens from there
constexpr std::size_t kNames = 3;               // of views in a sentence

std::string number(const JsonValue& value, int digits = 3) {
    return short_number(value.number_or(NAN), digits);
}
std::string percent(double share) {
    return str(std::lround(100 * share), " %");
}
std::string degrees(double angle) {
    return str(std::lround(angle), "\u00b0");
}

std::string list_of_names(const std::vector<std::string>& names) {
    std::string text;
    for (std::size_t i = 0; i < std::min(names.size(), kNames); ++i)
        text += (i ? ", " : "") + names[i];
    return names.size() > kNames ? str(text, " and ", names.size() - kNames, " more") : text;
}

double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    return sum / static_cast<double>(values.size());
}

class Judge {
public:
    explicit Judge(const JsonValue& report)
        : report_(report), summary_(report["summary"]), coverage_(report["coverage"]) {}

    RunVerdict verdict() {
        v_.what = what();
        quality();
        limits();
        next();
        left_out();
        return v_;
    }

private:
    std::string what() const {
        const JsonValue& s = summary_;
        const auto count = [](const JsonValue& value) {
            return static_cast<std::size_t>(std::max(0.0, value.number_or(0)));
        };
        std::string text;
        const std::size_t views = count(report_["training_views"]);
        text += views > 0 ? counted(views, "training view") : "The training views";
        const JsonValue& splats = report_["splats"] ? report_["splats"] : s["gaussians"];
        text += splats ? str(" became ", grouped(count(splats)), " splats") : " have no splats yet";
        if (const JsonValue& faces = report_["mesh"]["faces"])
            text += str(" and a mesh of ", grouped(count(faces)), " triangles");
        if (s["iteration"]) text += str(", in ", grouped(count(s["iteration"])), " iterations");
        if (s["seconds"]) text += str(" and ", number(s["seconds"]), " s of training");
        return str(text, ", on ", report_["run"]["device"].text_or("an unknown device"), ".",
                   size());
    }

    /// How large, how fine and how complete the mesh is.
    std::string size() const {
        std::string text;
        const JsonValue& mesh = report_["mesh"];
        const std::string unit = " " + mesh["unit"].text;
        if (const auto& sides = mesh["size"].items; sides.size() == 3)
            text += str(" The mesh measures ", number(sides[0]), " x ", number(sides[1]), " x ",
                        number(sides[2]), unit, mesh["unit"].text == "units" ? " of the scene" : "",
                        ".");
        if (const double pixel = report_["pixel"].number_or(0); pixel > 0 && !text.empty())
            text += str(" One pixel covers about ", short_number(pixel, 2), unit,
                        " of it; finer detail is not resolved.");
        const JsonValue &place = report_["placement"], &checked = place["checkpoint_rmse_m"];
        if (place["rmse_m"])
            text += str(
                " Control points or EXIF places fit to ", number(place["rmse_m"], 2), " m",
                checked ? str("; checkpoints, which took no part, to ", number(checked, 2), " m")
                        : "",
                ".");
        if (const JsonValue& two = coverage_["two"])
            text += str(" Two or more training views see ", percent(two.number),
                        " of the surface that they show.");
        return text;
    }

    /// The geometry of the mesh before the geometry of the centres; a later measurement before the
    /// one of the training.
    const JsonValue& geometry(const char*& of) const {
        for (const auto& [found, name] :
             {std::pair(&report_["results"]["geometry"], "mesh"),
              {&summary_["mesh"], "mesh"},
              {&report_["results"]["geometry_centres"], "splats' centres"},
              {&summary_["centres"], "splats' centres"}})
            if (const JsonValue& list = (*found)["thresholds"]; !list.items.empty()) {
                of = name;
                return list;
            }
        static const JsonValue none;
        return none;
    }

    void quality() {
        int level = 3;
        std::string text;
        const auto judge = [&](double value, double good, double fair) {
            level = std::min(level, value >= good ? 2 : value >= fair ? 1 : 0);
        };
        const JsonValue &all = summary_["psnr"] ? summary_["psnr"] : report_["nvs"]["psnr"],
                        &ssim = summary_["ssim"] ? summary_["ssim"] : report_["nvs"]["ssim"];
        if (all) {
            const JsonValue& masked = summary_["psnr_masked"];
            const bool object =
                masked && report_["config"]["loss"]["photometric"]["masks"].text == "object";
            const std::size_t views = report_["views"].items.size();
            text = str(views > 0 ? counted(views, "view") : "Views", " not used in training: PSNR ",
                       number(all), " dB");
            if (masked) text += str(" (on the object only: ", number(masked), " dB)");
            if (ssim) text += str(", SSIM ", number(ssim));
            text += str("; good from ", kGoodPsnr, " dB, fair from ", kFairPsnr, ". ");
            judge((object ? masked : all).number_or(0), kGoodPsnr, kFairPsnr);
        }
        const char* of = "";
        if (const JsonValue& thresholds = geometry(of); !thresholds.items.empty()) {
            const JsonValue& middle = thresholds.items[thresholds.items.size() / 2];
            text += str("Against the true surface: F1 of the ", of, " ", number(middle["f1"]),
                        " at ", number(middle["tau"]), " (precision ", number(middle["precision"]),
                        ", recall ", number(middle["recall"]), "); good from ", kGoodF1,
                        ", fair from ", kFairF1, ". ");
            judge(middle["f1"].number_or(0), kGoodF1, kFairF1);
        }
        if (text.empty())
            text =
                "Quality was not measured: no test views (--eval, --split) and no true surface "
                "(--gt). ";
        text.pop_back();
        v_.quality = text;
        if (level < 3)
            v_.level = std::array{"poor", "fair", "good"}[static_cast<std::size_t>(level)];
    }

    void limit(const std::string& text) { v_.limits.push_back(text); }

    void limits() {
        if (summary_["event"].text != "done" && summary_["iteration"])
            limit(str("The training has not ended: its log stops after ",
                      number(summary_["iteration"], 6), " of ",
                      number(report_["config"]["iterations"], 6), " iterations."));
        far_test_views();
        if (const JsonValue& two = coverage_["two"]; two.number_or(1) < 1 - kMuchSingleView)
            limit(str(percent(1 - two.number),
                      " of the surface in the training views is seen by a single view: no second "
                      "view checks its depth."));
        std::vector<std::string> alone;
        for (const JsonValue& view : coverage_["views"].items)
            if (view["shared"].number_or(0) < kFewShared) alone.push_back(view["name"].text);
        if (!alone.empty() && coverage_["views"].items.size() > 1)
            limit(str(alone.size() == 1 ? str("One training view shares less than ",
                                              percent(kFewShared), " of its surface")
                                        : str(alone.size(), " training views share less than ",
                                              percent(kFewShared), " of their surface"),
                      " with any other: ", list_of_names(alone), "."));
        const JsonValue& gap = coverage_["gap"];
        if (const double angle = gap["angle_deg"].number_or(0); angle > kWideGapDeg)
            limit(str("Neighbouring views are up to ", degrees(angle), " apart, ", gap["a"].text,
                      " and ", gap["b"].text, "; matching gets weak beyond ", degrees(kWideGapDeg),
                      "."));
        by_plan();
        growth();
        overtrained();
    }

    struct FarView {
        std::string name, nearest;
        double angle, psnr;
    };

    /// Test views more than kWideAngleDeg from every training view, with their PSNR.
    std::vector<FarView> far_views(std::vector<double>* near_psnr) const {
        std::vector<FarView> far;
        for (const JsonValue& test : coverage_["test"].items) {
            double psnr = NAN;
            for (const JsonValue& view : report_["views"].items)
                if (view["name"].text == test["name"].text) psnr = view["psnr"].number_or(NAN);
            const double angle = test["angle_deg"].number_or(0);
            if (!std::isfinite(psnr)) continue;
            if (angle > kWideAngleDeg)
                far.push_back({test["name"].text, test["nearest"].text, angle, psnr});
            else if (near_psnr != nullptr)
                near_psnr->push_back(psnr);
        }
        return far;
    }

    void far_test_views() {
        std::vector<double> near_psnr, far_psnr;
        for (const FarView& view : far_views(&near_psnr)) far_psnr.push_back(view.psnr);
        if (far_psnr.empty()) return;
        std::string text =
            str(far_psnr.size(), " of ", far_psnr.size() + near_psnr.size(),
                " test views stand more than ", degrees(kWideAngleDeg),
                " from every training view and reach ", short_number(mean(far_psnr), 3), " dB");
        if (!near_psnr.empty())
            text += str("; the nearer ones reach ", short_number(mean(near_psnr), 3), " dB");
        limit(text + ".");
    }

    void by_plan() {
        for (const JsonValue& d : report_["plan"].items) {
            if (!d["kept"].members.empty()) continue;  // not decided by the plan
            const std::string name = d["name"].text, choice = d["choice"].text,
                              reason = d["reason"].text;
            const bool below = d["measured"].number_or(0) < d["threshold"].number_or(0);
            if (name == "new splats" && choice == "yes" && below)
                limit(
                    str("The start points were sparse, so new splats were needed (", reason, ")."));
            if (name == "exposure" && choice != "no correction")
                limit(str("The photographs differ in exposure, which was ", choice, " (", reason,
                          "); lock the exposure of the camera."));
            if (name == "multi-view" && choice == "off")
                limit(str("Photographs were not compared with each other (", reason, ")."));
        }
    }

    void growth() {
        const double most = report_["memory"]["most_splats"].number_or(0),
                     first = report_["memory"]["first_splats"].number_or(0),
                     now = summary_["gaussians"].number_or(0);
        const bool grows = report_["config"]["densify"]["enabled"].number != 0;
        if (grows && most > first && now >= 0.98 * most)
            limit(str("Growth stopped at ", grouped(static_cast<std::size_t>(now)),
                      " splats, the limit by memory, --max-gaussians or densify.max_per_pixel."));
    }

    void overtrained() {
        // Where only the object was trained, use the object's PSNR.
        const bool object = report_["config"]["loss"]["photometric"]["masks"].text == "object";
        const char* const key = object && summary_["psnr_masked"] ? "psnr_masked" : "psnr";
        const double end = summary_[key].number_or(NAN);
        double best = end, at = 0;
        for (const JsonValue& e : report_["evaluations"].items)
            if (const double psnr = e[key].number_or(NAN); psnr > best)
                best = psnr, at = e["iteration"].number_or(0);
        if (best > end + kClearlyWorse)
            limit(str("PSNR was ", short_number(best, 3), " dB after ", short_number(at, 6),
                      " iterations and fell to ", short_number(end, 3),
                      " dB: train for fewer iterations."));
    }

    void next() {
        if (!coverage_) return;
        const std::vector<FarView> far = far_views(nullptr);
        const auto worst = std::ranges::min_element(far, {}, &FarView::psnr);
        if (worst != far.end())
            v_.next.push_back(str("From where the test view ", worst->name, " stands: PSNR ",
                                  short_number(worst->psnr, 3), " dB, and the nearest ",
                                  "training view, ", worst->nearest, ", is ", degrees(worst->angle),
                                  " away. Add one photograph every 15\u00b0 to ",
                                  "30\u00b0 between them."));
        const JsonValue& gap = coverage_["gap"];
        const double angle = gap["angle_deg"].number_or(NAN), shared = gap["shared"].number_or(0);
        if (gap && shared < kFewShared)
            v_.next.push_back(str("Between ", gap["a"].text, " and ", gap["b"].text,
                                  ": they share ", percent(shared),
                                  " of their surface, the weakest link between the views."));
        else if (angle > kWideGapDeg)
            v_.next.push_back(str("Between ", gap["a"].text, " and ", gap["b"].text, ": ",
                                  degrees(angle),
                                  " apart, the widest gap between neighbouring views."));
        const JsonValue* most = nullptr;
        for (const JsonValue& view : coverage_["views"].items)
            if (most == nullptr || view["lone"].number_or(0) > (*most)["lone"].number_or(0))
                most = &view;
        if (most != nullptr && (*most)["lone"].number_or(0) >= kMuchSingleView) {
            const std::string side = (*most)["side"].text;
            v_.next.push_back(str("The part that only ", (*most)["name"].text, " sees, ",
                                  percent((*most)["lone"].number), " of its surface",
                                  side.empty() ? "" : str(", most in its ", side, " half"),
                                  ": photograph it again from a step aside."));
        }
        if (!v_.next.empty()) return;
        std::string text = str("No gap was found: ", percent(coverage_["two"].number_or(0)),
                               " of the surface in the training views is seen by two of them");
        if (std::isfinite(angle))
            text += str(", and neighbours are at most ", degrees(angle), " apart");
        v_.next.push_back(text + ".");
    }

    void left_out() {
        if (!report_["plan"]) return;
        std::vector<std::string> off;
        for (const JsonValue& d : report_["plan"].items)
            if (const std::string& choice = d["choice"].text;
                (choice == "off" || choice == "none needed" || choice == "no correction") &&
                d["kept"].members.empty())
                off.push_back(str(d["name"].text, " (", d["reason"].text, ")"));
        for (const std::string& one : off) v_.left_out += (v_.left_out.empty() ? "" : "; ") + one;
        v_.left_out = off.empty() ? "Nothing." : v_.left_out + ".";
    }

    const JsonValue &report_, &summary_, &coverage_;
    RunVerdict v_;
};

}  // namespace

RunVerdict verdict_of(const JsonValue& report) {
    return Judge(report).verdict();
}

}  // namespace tvsgs
