#include "eval/tnt_curves.h"

#include <cmath>
#include <cstdio>

#include "core/error.h"
#include "io/files/atomic_file.h"

namespace tvsgs {
namespace {

std::string lines(const std::vector<double>& values) {
    std::string text;
    char line[40];
    for (const double v : values) {
        std::snprintf(line, sizeof line, "%.18e\n", v);  // as numpy.savetxt
        text += line;
    }
    return text;
}

constexpr double kLeft = 60, kTop = 40, kWidth = 400, kHeight = 300;  // plot area, px

/// Draws the fractions over the thresholds.
std::string polyline(const std::vector<double>& edges,
                     const std::vector<double>& values,
                     const char* style) {
    std::string points;
    char point[40];
    for (std::size_t i = 0; i < values.size(); ++i) {
        std::snprintf(point, sizeof point, "%.1f,%.1f ",
                      kLeft + kWidth * edges[i + 1] / edges.back(),
                      kTop + kHeight * (1 - values[i]));
        points += point;
    }
    return str("<polyline fill=\"none\" stroke-width=\"2\" ", style, " points=\"", points,
               "\"/>\n");
}

std::string svg(const std::string& scene, const TntMetrics& m, double tau) {
    char title[200];
    std::snprintf(title, sizeof title, "P %.4f, R %.4f, F1 %.4f at %g", m.precision, m.recall, m.f1,
                  tau);
    std::string safe;  // the name without characters of XML
    for (const char c : scene) safe += c == '<' || c == '&' || c == '>' ? '_' : c;
    std::string text =
        str("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 500 400\" "
            "font-family=\"sans-serif\" "
            "font-size=\"12\">\n<title>",
            safe, ": precision and recall</title>\n<desc>", title,
            "</desc>\n<rect width=\"500\" height=\"400\" fill=\"white\"/>\n<text x=\"", kLeft,
            "\" y=\"24\" font-size=\"14\">", safe, ": ", title, "</text>\n");
    for (int i = 0; i <= 5; ++i) {
        const double x = kLeft + kWidth * i / 5, y = kTop + kHeight * (5 - i) / 5;
        text += str("<path d=\"M", kLeft, " ", y, "h", kWidth, "\" stroke=\"#ddd\"/><text x=\"",
                    kLeft - 8, "\" y=\"", y + 4, "\" text-anchor=\"end\">", 20 * i,
                    " %</text><text x=\"", x, "\" y=\"", kTop + kHeight + 18,
                    "\" text-anchor=\"middle\">", i * tau, "</text>\n");
    }
    const double at = kLeft + kWidth / 5;
    text += str("<path d=\"M", at, " ", kTop, "v", kHeight,
                "\" stroke=\"#555\" stroke-dasharray=\"4\"/>\n",
                polyline(m.edges, m.precision_curve, "stroke=\"#0072b2\""),
                polyline(m.edges, m.recall_curve, "stroke=\"#d55e00\" stroke-dasharray=\"6 3\""));
    return text + str("<text x=\"", kLeft, "\" y=\"", kTop + kHeight + 38,
                      "\" fill=\"#0072b2\">precision (solid)</text>\n<text x=\"", kLeft + 130,
                      "\" y=\"", kTop + kHeight + 38,
                      "\" fill=\"#b24f00\">recall (dashed)</text>\n<text x=\"", kLeft + kWidth,
                      "\" y=\"", kTop + kHeight + 38,
                      "\" text-anchor=\"end\">distance</text>\n</svg>\n");
}

}  // namespace

void write_curves(const std::string& folder,
                  const std::string& scene,
                  const TntMetrics& m,
                  double tau) {
    const std::string stem = folder + "/" + scene;
    write_text_file(stem + ".precision.txt", lines(m.precision_curve));
    write_text_file(stem + ".recall.txt", lines(m.recall_curve));
    write_text_file(stem + ".prf_tau_plotstr.txt", lines({m.precision, m.recall, m.f1, tau, 5}));
    char number[16];
    std::snprintf(number, sizeof number, "%04ld", std::lround(10000 * tau));
    write_text_file(str(folder, "/PR_", scene, "_@d_th_0_", number, ".svg"), svg(scene, m, tau));
}

}  // namespace tvsgs
