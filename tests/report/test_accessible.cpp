// Accessibility of the pages in a browser, light and dark: names, headings, contrast by the formula
// of WCAG 2.2, keyboard access, and no external resources. scripts/page_judges.mjs runs independent
// checkers.
#include <gtest/gtest.h>

#include "io/files/atomic_file.h"
#include "report/page_data.h"
#include "report/report.h"
#include "view_cases.h"

namespace tvsgs {
namespace {

/// Writes a list of problems into the page.
constexpr const char* kCheck = R"JS(<script>
function channels(color) {  // of "rgb(1, 2, 3)" or "rgba(1, 2, 3, 0.4)"
  const n = color.match(/[\d.]+/g).map(Number);
  return n.length > 3 ? n : [...n, 1];
}
const over = (top, below) => [0, 1, 2].map(c => top[3] * top[c] + (1 - top[3]) * below[c]).concat(1);
function luminance(rgb) {
  const [r, g, b] = rgb.map(c => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
function contrast(a, b) {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (high + 0.05) / (low + 0.05);
}
/** What lies behind an element; `unknown`: behind all, where it lies over a picture. */
function backdrop(e, unknown) {
  if (!e) return [255, 255, 255, 1];
  if (e.id === 'stage') return unknown;
  const own = channels(getComputedStyle(e).backgroundColor);
  return own[3] === 1 ? own : over(own, backdrop(e.parentElement, unknown));
}
const opacity = e => e ? getComputedStyle(e).opacity * opacity(e.parentElement) : 1;
const shown = e => e.checkVisibility({opacityProperty: true, visibilityProperty: true}) &&
    e.getClientRects().length > 0;
const html = e => e.outerHTML.slice(0, 80);
function nameOf(e) {
  const by = e.getAttribute('aria-labelledby');
  if (by) return by.split(/\s+/).map(id => document.getElementById(id)?.textContent ?? '').join(' ').trim();
  const labels = [...(e.labels || [])].map(l => l.textContent).join(' ');
  const inside = [...e.querySelectorAll('img')].map(i => i.alt).join(' ') + e.textContent;
  const text = ['CANVAS', 'svg', 'IFRAME', 'INPUT'].includes(e.tagName) ? '' : inside;
  return (e.getAttribute('aria-label') || labels || text || e.title || '').trim();
}
function complaints() {
  const found = [], all = selector => [...document.querySelectorAll(selector)];
  const complain = (what, e) => found.push(what + (e ? ': ' + html(e) : ''));
  if (document.documentElement.lang !== 'en') complain('no language');
  if (!document.title.trim()) complain('no title');
  if (!document.querySelector('meta[name=viewport]')) complain('no viewport');
  for (const mark of ['header', 'main', 'footer'])
    if (all(mark).length !== 1) complain('not one ' + mark);
  let level = 0;
  for (const h of all('h1, h2, h3, h4, h5, h6').filter(shown)) {
    const own = Number(h.tagName[1]);
    if (own > level + 1 || (own === 1 && level > 0) || !h.textContent.trim()) complain('heading', h);
    level = own;
  }
  const ids = all('[id]').map(e => e.id);
  ids.forEach((id, i) => ids.indexOf(id) !== i && complain('id twice: ' + id));
  for (const e of all('a, button, input, select, textarea, iframe, summary, [role=application], [role=group], svg'))
    if (!nameOf(e)) complain('no name', e);
  for (const e of all('img')) if (!e.hasAttribute('alt')) complain('no alternative', e);
  for (const e of all('table')) if (!e.caption || !e.querySelector('th[scope]')) complain('table', e);
  for (const e of all('[tabindex]')) if (e.tabIndex > 0) complain('order of Tab', e);
  for (const e of all('[onclick]')) complain('handler', e);
  // Texts.
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    const e = node.parentElement, style = getComputedStyle(e);
    if (!node.textContent.trim() || !shown(e) || e.closest('pre, noscript')) continue;
    const size = parseFloat(style.fontSize), bold = style.fontWeight >= 600;
    const needed = size >= 24 || (size >= 18.66 && bold) ? 3 : 4.5;
    const ink = channels(e.closest('svg') ? style.fill : style.color);
    ink[3] *= opacity(e);
    for (const unknown of [[0, 0, 0, 1], [255, 255, 255, 1]]) {
      const behind = backdrop(e, unknown), c = contrast(over(ink, behind), behind);
      if (c < needed) complain(`contrast ${c.toFixed(2)} of "${node.textContent.trim().slice(0, 30)}"`, e);
    }
  }
  for (const e of all('svg .line, svg .bar').filter(shown)) {
    const s = getComputedStyle(e), line = channels(e.classList.contains('bar') ? s.fill : s.stroke);
    const c = contrast(line, backdrop(e));
    if (c < 3) complain(`contrast ${c.toFixed(2)} of a line`, e.parentElement);
  }
  for (const e of all('svg')) {
    const keys = [...e.querySelectorAll('.line[d$=h26]')].map(getComputedStyle);
    if (new Set(keys.map(s => s.stroke + s.strokeDasharray)).size < keys.length) complain('lines alike', e);
  }
  // Keys.
  for (const e of all('a[href], button, input, summary, iframe, [tabindex]')) {
    if (!shown(e) || e.disabled) continue;
    e.focus();
    if (document.activeElement !== e || e.tabIndex < 0) {
      complain('no focus', e);
      continue;
    }
    const ring = e.id === 'canvas' ? element('stage') : e;  // pictures lie over the canvas
    const s = getComputedStyle(ring), box = e.getBoundingClientRect();
    const c = contrast(channels(s.outlineColor), backdrop(ring.parentElement));
    if (s.outlineStyle === 'none' || parseFloat(s.outlineWidth) < 2 || c < 3)
      complain(`focus does not show, ${c.toFixed(2)}`, e);
    if (e.tagName !== 'INPUT' && (box.width < 24 || box.height < 24)) complain('too small a target', e);
  }
  document.activeElement.blur();
  for (const e of all('*').filter(shown)) {
    const s = getComputedStyle(e), scrolls = /auto|scroll/;
    if (e === document.documentElement || e === document.body) continue;
    const more = (scrolls.test(s.overflowY) && e.scrollHeight > e.clientHeight + 1) ||
        (scrolls.test(s.overflowX) && e.scrollWidth > e.clientWidth + 1);
    if (more && e.tabIndex < 0 && !e.querySelector('a[href], button, input, [tabindex="0"]')) complain('scrolls by mouse alone', e);
  }
  const wide = document.documentElement.scrollWidth - innerWidth;
  if (wide > 0) complain(`${wide} px wider than the window`);
  // From elsewhere.
  for (const e of all('[src], [href], [action], [srcset], [data]'))
    for (const a of ['src', 'href', 'action', 'srcset', 'data'])
      if (e.hasAttribute(a) && !/^(data:|blob:|#)/.test(e.getAttribute(a))) complain('from elsewhere', e);
  for (const entry of performance.getEntriesByType('resource'))
    if (!/^(data:|blob:)/.test(entry.name)) complain('has asked for ' + entry.name);
  if (all('[role=status], [aria-live=polite]').length === 0 && document.querySelector('canvas')) complain('nothing is said');
  return found;
}
function report() {
  const out = document.createElement('pre');
  out.id = 'complaints';
  out.textContent = JSON.stringify({list: complaints(), dark: matchMedia('(prefers-color-scheme: dark)').matches});
  document.body.append(out);
}
if (typeof Viewer === 'undefined') {
  addEventListener('load', report);
} else {
  window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 60);
  const begin = Viewer.prototype.begin;
  Viewer.prototype.begin = function() {
    begin.call(this);
    patiently((async () => {
      const pause = ms => new Promise(done => setTimeout(done, ms));
      await pause(100);
      this.canvas.blur();
      this.goTo(0);  // the slider of the photograph, the scale of errors, tools, dialogs
      this.setMode('error');
      this.cut();
      this.fold(false);
      element('copied').hidden = false;
      for (const dialog of document.querySelectorAll('dialog')) dialog.open = true;
      do await pause(50); while (this.flight || this.camera < 0);
      report();
    })());
  };
}
</script>)JS";

/// Problems of a page in that colour scheme.
std::vector<std::string> complaints(std::string page, const fs::path& in, bool dark) {
    const fs::path file = in / "page.html";
    const std::string mark = "</body>";
    write_text_file(file, page.insert(page.rfind(mark), kCheck));
    const std::string html =
        page_in_browser(file, "?wait",
                        dark ? "--window-size=500,700 --blink-settings=preferredColorScheme=0"
                             : "--window-size=1280,900 --blink-settings=preferredColorScheme=1");
    const std::string text = text_of(html, "complaints");
    EXPECT_FALSE(text.empty()) << text_of(html, "status") << contents(in / "err.txt");
    if (text.empty()) return {};
    const JsonValue found = parse_json_value(text, "complaints");
    EXPECT_EQ(found["dark"].number != 0, dark);
    std::vector<std::string> list;
    for (const JsonValue& one : found["list"].items) list.push_back(one.text);
    return list;
}

void expect_none(const std::string& page, const std::string& name) {
    for (const bool dark : {false, true})
        for (const std::string& one : complaints(page, folder(name), dark))
            ADD_FAILURE() << name << (dark ? ", dark: " : ", light: ") << one;
}

/// Two runs with all parts of a page: mesh, truth, photographs, plots, notes.
ViewPage full_view() {
    std::vector<ViewRun> runs;
    for (const std::string name : {"statue", "other"}) {
        ViewRun run = run_of(name, "ewa", test::random_gaussians(60, 1));
        run.mesh.vertices = {{0, -1, 2}, {1, 1, 2}, {3, 0, 2}};
        run.mesh.colors.assign(3, {1, 1, 1});
        run.mesh.faces = {{2, 1, 0}};
        run.mesh_faces = 9;
        run.truth.emplace();
        run.truth->surface = measured_points({{0, 0, 0}}, {}, {});
        run.truth->taus = {0.5};
        run.evaluations = parse_json_value(
            R"([{"seconds": 1, "psnr": 20, "ssim": 0.5}, {"seconds": 5, "psnr": 25, "ssim": 0.7}])",
            "evaluations");
        runs.push_back(std::move(run));
    }
    ViewPageOptions options;
    options.max_splats = 50;
    return view_page({std::move(runs), two_cameras()}, options);
}

std::string full_report() {
    const std::string picture =
        "data:image/jpeg;base64," + base64(jpeg_bytes(ImageU8(8, 6, 3), 80));
    const auto image = [&](const char* key) {
        return str("\"", key, "\": {\"src\": \"", picture, "\", \"width\": 8, \"height\": 6}, ");
    };
    const JsonValue report = parse_json_value(
        str(R"({"run": {"name": "statue", "scene": "s", "device": "cpu", "version": "tvsgs 0"},
            "config": {"backbone": "ewa", "seed": 1, "tv": {"enabled": true, "k": 64}},
            "plan": [{"name": "new splats", "choice": "none needed", "reason": "enough"}],
            "summary": {"event": "done", "iteration": 100, "seconds": 9, "gaussians": 60, "psnr": 25,
                        "peak_bytes": 9000000},
            "missing": ["the truth"],
            "evaluations": [{"seconds": 1, "psnr": 20, "ssim": 0.5}, {"seconds": 5, "psnr": 25, "ssim": 0.7}],
            "reports": {"iteration": [50, 100], "seconds": [4, 9], "gaussians": [50, 60], "loss": [2, 1],
                        "bytes": [1e6, 2e6], "peak_bytes": [1e6, 2e6],
                        "terms": {"a": [1, 2], "b": [1, 2], "c": [1, 2], "d": [1, 2], "e": [1, 2], "f": [1, 2],
                                  "g": [2, 1], "h": [3, 1]}},
            "stages": {"render": 5, "vote": 2},
            "curve": {"tau": [0, 1, 2], "precision": [0, 0.5, 1], "recall": [0, 0.2, 1]},
            "views": [{"name": "a.png", "psnr": 25, "ssim": 0.7}, {"name": "b.png", "psnr": 24, "ssim": 0.6}],
            "pictures": [{)",
            image("photo"), image("render"), image("difference"), image("normal"), image("depth"),
            R"("name": "a.png", "psnr": 25, "ssim": 0.7}],
            "results": {"geometry": {"chamfer": 0.5}}})"),
        "report");
    return report_html(report, full_view());
}

class AccessiblePages : public ViewInBrowser {};

TEST_F(AccessiblePages, Views) {
    expect_none(full_view().html, "views");
}

TEST_F(AccessiblePages, Reports) {
    expect_none(full_report(), "report");
}

// The check finds defects made on purpose.
TEST_F(AccessiblePages, TheCheckFindsWhatIsWrong) {
    std::string page = full_report();
    const auto spoil = [&](const std::string& from, const std::string& to) {
        const std::size_t at = page.find(from);
        ASSERT_NE(at, std::string::npos) << from;
        page.replace(at, from.size(), to);
    };
    spoil("lang=\"en\"", "");
    spoil("--quiet:#55585e", "--quiet:#85888e");
    spoil("outline:3px solid", "outline:0 solid");
    spoil("--c0:#0072b2", "--c0:#a0d2f2");
    spoil(".plot .again .line", ".plot .never .line");
    spoil("Open the view in 3D", "");
    spoil("<h3>", "<h5>");
    spoil(" alt=\"", " title=\"");
    spoil("</footer>", "<img src=\"x.png\" alt=\"\"></footer>");
    spoil("</footer>", "<p style=\"min-width:3000px\">wide</p></footer>");
    // All of them: tables of plots are folded.
    const std::string table = "class=\"scroll\" tabindex=\"0\"";
    while (page.find(table) != std::string::npos)
        spoil(table, "style=\"height:5px;overflow:auto\" class=\"s\"");
    const auto found = complaints(page, folder("spoilt"), false);
    for (const std::string what :
         {"no language", "contrast 3", "focus does not show", "of a line", "lines alike", "no name",
          "heading", "no alternative", "from elsewhere", "wider than the window",
          "scrolls by mouse alone"})
        EXPECT_TRUE(std::any_of(found.begin(), found.end(), [&](const std::string& one) {
            return one.find(what) != std::string::npos;
        })) << what;
}

}  // namespace
}  // namespace tvsgs
