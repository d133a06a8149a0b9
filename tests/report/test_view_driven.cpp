// Pages of tvsgs-view under user input, and while they follow a training.
#include <gtest/gtest.h>

#include "io/files/atomic_file.h"
#include "io/splats/spz.h"
#include "report/pictures.h"
#include "view_cases.h"

namespace tvsgs {
namespace {

// Performs actions of a user, and records the view after each.
TEST_F(ViewInBrowser, KeysPointersAndButtonsMoveTheView) {
    const std::string script = R"JS(<script>
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 60);
const begin = Viewer.prototype.begin, seen = {};
Viewer.prototype.begin = function() { begin.call(this); drive(this); };
async function drive(viewer) {
  const canvas = element('canvas');
  const note = name => { seen[name] = [...viewer.view.centre, ...viewer.view.rows.flat()].map(x => x.toFixed(6)).join(); };
  const rest = async () => { do await new Promise(done => setTimeout(done, 50)); while (viewer.flight); };
  const key = (k, shift) => canvas.dispatchEvent(new KeyboardEvent('keydown', {key: k, shiftKey: shift, cancelable: true}));
  const point = (type, id, x, y) => canvas.dispatchEvent(new PointerEvent(type, {pointerId: id, clientX: x, clientY: y}));
  canvas.setPointerCapture = () => {};  // there is no such pointer
  await rest(); note('start');
  key('ArrowLeft'); note('left'); key('ArrowRight'); note('back');
  key('ArrowUp', true); note('shifted'); key('ArrowDown', true); note('unshifted');
  key('+'); note('near'); key('0'); await rest(); note('reset');
  point('pointerdown', 1, 100, 100); point('pointermove', 1, 140, 100); note('dragged');
  point('pointerdown', 2, 200, 100); point('pointermove', 2, 240, 100); note('pinched');
  point('pointerup', 1, 140, 100); point('pointerup', 2, 240, 100); point('pointermove', 1, 10, 10); note('released');
  key('Home'); await rest(); canvas.blur(); note('home');
  const wheel = () => canvas.dispatchEvent(new WheelEvent('wheel', {deltaY: 100, cancelable: true}));
  wheel(); note('unfocused'); canvas.focus(); wheel(); note('wheel');
  document.querySelector('button[data-camera="0"]').click(); await rest(); await rest(); note('camera');
  const cloud = viewer.renderer.runs[0].cloud;
  await patiently((async () => {  // until it has come to rest, the order is that of the view
    while (cloud.sorting || cloud.sortedFor.fx !== viewer.view.rows[2][0] || cloud.drawn === 0)
      await new Promise(done => setTimeout(done, 20));
  })());
  seen.status = element('status').textContent;
  const pane = document.querySelector('.pane').getBoundingClientRect(), photo = document.querySelector('.pane img');
  const lens = lensIn(viewer.view, pane.width, pane.height), c = about.cameras[0], p = photo.getBoundingClientRect();
  const s = lens.fx / c.fx, left = pane.left + lens.cx - s * c.cx, top = pane.top + lens.cy - s * c.cy;
  seen.photo = photo.hidden ? 1e9 : Math.max(Math.abs(p.left - left), Math.abs(p.top - top),
      Math.abs(p.right - left - s * c.width), Math.abs(p.bottom - top - s * c.height));
  seen.current = document.querySelector('button[aria-current]').dataset.camera;
  key(']'); await rest(); seen.next = viewer.camera;
  key('ArrowLeft'); await rest(); seen.after = viewer.camera; seen.hidden = photo.hidden;
  key('s'); seen.splats = document.querySelector('button[data-show=splats]').getAttribute('aria-pressed');
  key('c'); seen.centres = viewer.show.centres;
  key('m'); seen.mesh = viewer.show.mesh;  // there is none
  const out = document.createElement('pre');
  out.id = 'seen';
  out.textContent = JSON.stringify(seen);
  document.body.append(out);
}
</script>)JS";
    std::vector<ViewRun> runs;
    runs.push_back(run_of("run", "ewa", test::random_gaussians(50, 4)));
    std::string page = view_page(std::move(runs), two_cameras()).html;
    const fs::path file = folder("driven") / "page.html";
    write_text_file(file, page.insert(page.rfind("</body>"), script));
    const std::string html = page_in_browser(file, "?wait", "--window-size=500,600"),
                      text = text_of(html, "seen");
    EXPECT_EQ(contents(file.parent_path() / "err.txt").find("CONSOLE"), std::string::npos)
        << contents(file.parent_path() / "err.txt");
    ASSERT_FALSE(text.empty()) << text_of(html, "status");
    const JsonValue seen = parse_json_value(text, "seen");
    const auto at = [&](const char* name) { return seen[name].text; };
    for (const char* moved : {"left", "shifted", "near", "dragged", "wheel", "camera"})
        EXPECT_NE(at(moved), at("start")) << moved;
    EXPECT_EQ(at("back"), at("start"));
    EXPECT_EQ(at("unshifted"), at("start"));
    EXPECT_EQ(at("reset"), at("start"));
    EXPECT_NE(at("pinched"), at("dragged"));
    EXPECT_EQ(at("released"), at("pinched"));
    EXPECT_EQ(at("unfocused"), at("home")) << "the wheel is the page's until the view is chosen";
    EXPECT_NE(at("status").find("Camera 1 of 2: left.jpg"), std::string::npos) << at("status");
    EXPECT_LT(seen["photo"].number_or(1e9), 1) << "px: the photograph lies where its camera saw it";
    EXPECT_EQ(at("current"), "0");
    EXPECT_EQ(seen["next"].number_or(9), 1);
    EXPECT_EQ(seen["after"].number_or(9), -1) << "moving on takes the photograph away";
    EXPECT_EQ(seen["hidden"].number, 1);
    EXPECT_EQ(at("splats"), "false");
    EXPECT_EQ(seen["centres"].number, 1);
    EXPECT_TRUE(seen["mesh"].is(JsonValue::Kind::boolean) && seen["mesh"].number == 0);
}

TEST_F(ViewInBrowser, SplatsAreOrderedFromBackToFront) {
    const std::string script = R"JS(<script>
Viewer.prototype.begin = function() {
  patiently((async () => {
    const n = 5000, positions = new Float32Array(3 * n), worker = workerOf(`(${sorter})()`), seen = {};
    for (let i = 0; i < 3 * n; ++i) positions[i] = 3 * Math.sin(12.9898 * (i + 1)) * (i % 30 < 3 ? 20 : 1);
    for (let i = 0; i < 30; ++i) positions[i] = 0.5;  // ten in one place
    const places = positions.slice(), forward = [0.6, 0, 0.8], offset = 4, near = 0.2;
    const depth = i => Math.fround(forward[0] * places[3 * i] + forward[1] * places[3 * i + 1] + forward[2] * places[3 * i + 2] + offset);
    worker.postMessage({positions}, [positions.buffer]);
    for (const exactly of [true, false]) {
      const {order, count} = await new Promise(done => {
        worker.onmessage = ({data}) => done(data);
        worker.postMessage({forward, offset, near, exactly});
      });
      const own = [...order.slice(0, count)];
      let worst = 0, ties = 0;
      for (let k = 1; k < count; ++k) {
        worst = Math.max(worst, depth(own[k]) / depth(own[k - 1]) - 1);
        if (depth(own[k]) === depth(own[k - 1]) && own[k] > own[k - 1]) ++ties;
      }
      seen[exactly ? 'rest' : 'move'] = {count, worst, ties, different: new Set(own).size, behind: own.filter(i => !(depth(i) > near)).length,
          first: own.filter(i => i < 10).join()};
    }
    seen.expected = places.filter((_, i) => i % 3 === 0 && depth(i / 3) > near).length;
    const out = document.createElement('pre');
    out.id = 'seen';
    out.textContent = JSON.stringify(seen);
    document.body.append(out);
  })());
};
</script>)JS";
    std::vector<ViewRun> runs;
    runs.push_back(run_of("run", "ewa", test::random_gaussians(50, 4)));
    std::string page = view_page(std::move(runs), two_cameras()).html;
    const fs::path file = folder("ordered") / "page.html";
    write_text_file(file, page.insert(page.rfind("</body>"), script));
    const std::string html = page_in_browser(file, "?wait"), text = text_of(html, "seen");
    ASSERT_FALSE(text.empty()) << text_of(html, "status");
    const JsonValue seen = parse_json_value(text, "seen");
    for (const char* when : {"rest", "move"}) {
        const JsonValue& order = seen[when];
        EXPECT_EQ(order["count"].number, seen["expected"].number) << when;
        EXPECT_GT(order["count"].number, 1000) << when;
        EXPECT_LT(order["count"].number, 5000) << when << ": some are behind the camera";
        EXPECT_EQ(order["different"].number, order["count"].number) << when;
        EXPECT_EQ(order["behind"].number, 0) << when;
        EXPECT_EQ(order["first"].text, "9,8,7,6,5,4,3,2,1,0") << when << ": in one place";
    }
    EXPECT_LT(seen["rest"]["worst"].number_or(1), 1e-6);
    EXPECT_LT(seen["move"]["worst"].number_or(1), 3e-4);
    EXPECT_GT(seen["move"]["worst"].number_or(0), 1e-6) << "not as exact as at rest";
}

// With prepared answers of a server.
TEST_F(ViewInBrowser, ATrainingIsFollowedToItsEnd) {
    const std::string script = R"JS(<script>
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 60);
const snapshot = decodeBase64(element('snapshot').textContent), made = [], seen = {};
const makeCloud = Renderer.prototype.makeCloud, begin = Viewer.prototype.begin;
Renderer.prototype.makeCloud = function(run, splats) {
  made.push({count: splats.count, first: [...splats.positions.slice(0, 3)]});
  return makeCloud.call(this, run, splats);
};
let asked = 0;
const later = window.setTimeout;
window.setTimeout = (act, ms) => later(act, Math.min(ms, 20));
window.fetch = async path => path === 'api/splats' ? {arrayBuffer: async () => snapshot.buffer} :
    {json: async () => ({live: ++asked > 1 && asked < 4, tag: 'one', iteration: 1234, iterations: 5000,
                         gaussians: 200, seconds: 7, age: 0, origin: [7, 0, 0]})};
Viewer.prototype.begin = function() {
  begin.call(this);
  patiently((async () => {
    const wait = () => new Promise(done => setTimeout(done, 20)), run = this.renderer.runs[0];
    while (!element('training').textContent.includes('1,234')) await wait();
    while (run.cloud.drawn === 0) await wait();
    seen.drawn = run.cloud.drawn;
    while (!element('training').textContent.includes('ended')) await wait();
    const out = document.createElement('pre');
    out.id = 'seen';
    out.textContent = JSON.stringify({...seen, made});
    document.body.append(out);
  })());
};
</script>)JS";
    const Gaussians<Cpu> splats = test::random_gaussians(200, 4, 0.05, 0);
    const std::vector<std::uint8_t> spz = spz_bytes(splats, {.frame = SplatFrame::rdf});
    Gaussians<Cpu> none;
    resize(none, 0, 0);
    std::vector<ViewRun> runs;
    runs.push_back(run_of("run", "ewa", std::move(none)));
    ViewPageOptions options;
    options.follow = Vec3d{7, 0, -1};  // where the page's frame is; the snapshots' is at 7 0 0
    std::string page = view_page(std::move(runs), two_cameras(), options).html;
    EXPECT_NE(page.find("connect-src 'self'"), std::string::npos);
    const fs::path file = folder("followed") / "page.html";
    write_text_file(file, page.insert(page.rfind("</body>"),
                                      "<script type=\"application/octet-stream\" id=\"snapshot\">" +
                                          base64({spz.begin(), spz.end()}) + "</script>" + script));
    const std::string html = page_in_browser(file, "?wait", "--window-size=500,600"),
                      text = text_of(html, "seen");
    ASSERT_FALSE(text.empty()) << text_of(html, "training") << text_of(html, "status");
    const JsonValue seen = parse_json_value(text, "seen");
    EXPECT_EQ(seen["drawn"].number, 200);
    ASSERT_FALSE(seen["made"].items.empty());
    EXPECT_EQ(seen["made"].items.back()["count"].number, 200);
    const auto& first = seen["made"].items.back()["first"].items;
    ASSERT_EQ(first.size(), 3u);
    EXPECT_NEAR(first[0].number, double(splats.means[0].x), 1e-4);
    EXPECT_NEAR(first[2].number, double(splats.means[0].z) + 1, 1e-4) << "from frame to frame";
}

}  // namespace
}  // namespace tvsgs
