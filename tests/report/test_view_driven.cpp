// Pages of tvsgs-view under user input, and while they follow a training.
#include <gtest/gtest.h>

#include "core/math/rigid.h"
#include "io/files/atomic_file.h"
#include "io/splats/splat_files.h"
#include "report/page_data.h"
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
  key('PageUp'); note('ahead'); key('PageDown'); note('behind');
  key('+'); note('near'); key('0'); await rest(); note('reset');
  point('pointerdown', 1, 100, 100); point('pointermove', 1, 140, 100); note('dragged');
  point('pointerdown', 2, 200, 100); point('pointermove', 2, 240, 100); note('pinched');
  point('pointerup', 1, 140, 100); point('pointerup', 2, 240, 100); point('pointermove', 1, 10, 10); note('released');
  key('Home'); await rest(); canvas.blur(); note('home');
  const wheel = () => canvas.dispatchEvent(new WheelEvent('wheel', {deltaY: 100, cancelable: true}));
  wheel(); note('wheel');
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
  const button = document.querySelector('button[data-show=photo]');
  seen.without = [button.disabled, element('why').textContent].join(); key('Enter'); await rest(); await rest(); seen.with = button.disabled;
  document.documentElement.requestFullscreen = () => { seen.full = 1; return Promise.reject(); };
  key('u'); await rest(); seen.refused = element('status').textContent;
  key('c'); seen.centres = viewer.mode + modeInput('centres').checked;
  key('m'); seen.mesh = viewer.mode;  // there is none
  key('f'); seen.cameras = viewer.show.cameras;
  element('opacity').value = 90; key('0'); await rest();
  seen.again = [viewer.mode, viewer.show.cameras, viewer.show.photo, element('opacity').value].join();
  const out = document.createElement('pre');
  out.id = 'seen';
  out.textContent = JSON.stringify(seen);
  document.body.append(out);
}
</script>)JS";
    std::vector<ViewRun> runs;
    runs.push_back(run_of("run", "ewa", test::random_gaussians(50, 4)));
    std::string page = view_page({std::move(runs), two_cameras()}).html;
    const fs::path file = folder("driven") / "page.html";
    write_text_file(file, page.insert(page.rfind("</body>"), script));
    const std::string html = page_in_browser(file, "?wait", "--window-size=500,600"),
                      text = text_of(html, "seen");
    EXPECT_EQ(contents(file.parent_path() / "err.txt").find("CONSOLE"), std::string::npos)
        << contents(file.parent_path() / "err.txt");
    ASSERT_FALSE(text.empty()) << text_of(html, "status");
    const JsonValue seen = parse_json_value(text, "seen");
    const auto at = [&](const char* name) { return seen[name].text; };
    for (const char* moved : {"left", "shifted", "ahead", "near", "dragged", "wheel", "camera"})
        EXPECT_NE(at(moved), at("start")) << moved;
    EXPECT_EQ(at("back"), at("start"));
    EXPECT_EQ(at("unshifted"), at("start"));
    EXPECT_EQ(at("behind"), at("start"));
    EXPECT_EQ(at("reset"), at("start"));
    EXPECT_NE(at("pinched"), at("dragged"));
    EXPECT_EQ(at("released"), at("pinched"));
    EXPECT_NE(at("status").find("Camera 1 of 2: left.jpg"), std::string::npos) << at("status");
    EXPECT_LT(seen["photo"].number_or(1e9), 1) << "px: the photograph lies where its camera saw it";
    EXPECT_EQ(at("current"), "0");
    EXPECT_EQ(seen["next"].number_or(9), 1);
    EXPECT_EQ(seen["after"].number_or(9), -1) << "moving on takes the photograph away";
    EXPECT_EQ(seen["hidden"].number, 1);
    EXPECT_EQ(at("without"), "true,Choose a camera first.");
    EXPECT_TRUE(seen["with"].is(JsonValue::Kind::boolean) && seen["with"].number == 0);
    EXPECT_EQ(seen["full"].number_or(0), 1);
    EXPECT_EQ(at("refused"), "The browser allows no full screen here.");
    EXPECT_EQ(at("centres"), "centrestrue");
    EXPECT_EQ(at("mesh"), "centres");
    EXPECT_TRUE(seen["cameras"].is(JsonValue::Kind::boolean) && seen["cameras"].number == 0);
    EXPECT_EQ(at("again"), "splats,true,true,50") << "0 resets all that is shown";
}

/// A tilted square around `middle` of splats and of triangles, and other splats one unit behind it.
ViewRun plane_run(Vec3f middle, Vec3f across, Vec3f down, Vec3f normal) {
    constexpr int kSide = 24;
    Gaussians<Cpu> g;
    resize(g, 2 * kSide * kSide, 0);
    Mat3<double> R;
    for (int r = 0; r < 3; ++r)
        R[r][0] = double(across[r]), R[r][1] = double(down[r]), R[r][2] = double(normal[r]);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const int k = static_cast<int>(i) % (kSide * kSide);
        const auto at = [](int n) { return 2.2f * static_cast<float>(n) / (kSide - 1) - 1.1f; };
        g.means[i] = middle + at(k % kSide) * across + at(k / kSide) * down;
        if (i >= kSide * kSide) g.means[i] = g.means[i] + normal;
        g.log_scales[i] = {-2.5f, -2.5f, -7};
        g.quats[i] = quat_cast<float>(quaternion(R));
        g.opacity_logits[i] = -0.5f;
        g.sh[i] = {1, 1, 1};
    }
    ViewRun run = run_of("run", "ewa", std::move(g));
    for (const float x : {-1.1f, 1.1f})
        for (const float y : {-1.1f, 1.1f})
            run.mesh.vertices.push_back(middle + x * across + y * down);
    run.mesh.faces = {{0, 1, 2}, {2, 1, 3}};
    run.mesh_faces = 2;
    return run;
}

TEST_F(ViewInBrowser, PointsOnTheSurfaceLinksAndLimits) {
    const std::string script = R"JS(<script>
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 60);
const begin = Viewer.prototype.begin, seen = {};
Viewer.prototype.begin = function() { begin.call(this); drive(this); };
async function drive(viewer) {
  const canvas = element('canvas'), pause = ms => new Promise(done => setTimeout(done, ms));
  const rest = async () => { do await pause(50); while (viewer.flight); };
  const key = k => canvas.dispatchEvent(new KeyboardEvent('keydown', {key: k, cancelable: true}));
  canvas.setPointerCapture = () => {};  // there is no such pointer
  const [A, B, normal] = points, apart = norm(minus(A, B));
  const pixel = place => {
    const box = viewer.panes[0].getBoundingClientRect();
    const [x, y, z] = projected(viewer.view, lensIn(viewer.view, box.width, box.height), place);
    return [box.left + x / z, box.top + y / z];
  };
  const click = place => {
    const [clientX, clientY] = pixel(place);
    for (const type of ['pointerdown', 'pointerup']) canvas.dispatchEvent(new PointerEvent(type, {pointerId: 1, clientX, clientY}));
  };
  viewer.still = {matches: true};  // no flights
  await rest();
  seen.status = element('status').textContent, seen.mode = viewer.mode;
  key('f');
  for (const mode of ['s', 'm']) {
    key(mode); key('d'); click(A); click(B);
    seen['distance' + mode] = Math.abs(norm(minus(...viewer.points)) - apart);
    seen['place' + mode] = norm(minus(viewer.points[1], B));
    seen['text' + mode] = element('status').textContent;
    key('Escape');
  }
  click(A); click(A);
  seen.pivot = norm(minus(viewer.view.pivot, A));
  const before = pixel(A);
  for (let i = 0; i < 4; ++i) key('ArrowLeft');
  seen.turned = Math.hypot(...minus([...pixel(A), 0], [...before, 0]));
  key('b'); viewer.box.high[0] = 0; viewer.stateOfBox();
  click(A); click(A);
  seen.cut = element('status').textContent, seen.box = viewer.boxNumbers().join();
  key('g');
  const linked = viewer.view, box = JSON.stringify(viewer.box);
  const numbers = v => [...v.centre, ...v.rows.flat(), ...v.pivot, v.lens.fx];
  const open = address => {
    viewer.view = viewer.home, viewer.mode = 'splats', viewer.box = null, viewer.camera = -1;
    for (const name of ['show', 'camera', 'view', 'zoom', 'box']) query.delete(name);
    for (const [name, value] of new URLSearchParams(address.split('?')[1])) query.set(name, value);
    return viewer.readAddress().join();
  };
  seen.unread = open(viewer.link());
  seen.link = Math.max(...numbers(linked).map((x, i) => Math.abs(x - numbers(viewer.view)[i])));
  seen.linked = [viewer.mode, Math.max(...[...viewer.box.low, ...viewer.box.high].map((x, i) => Math.abs(x - Object.values(JSON.parse(box)).flat()[i]))) < 1e-5].join();
  seen.bad = open('?view=1,0,0,0,0,0,0,0,0,0,0,0&box=1,1,1,0,2,2&zoom=-1&camera=1.5');
  open('?camera=2&zoom=3');
  seen.zoom = viewer.view.distance / viewOf(about.cameras[1], about.scene).distance;
  key('0'); await rest();
  const side = () => dot(minus(viewer.view.centre, A), normal);
  seen.before = side();
  for (let i = 0; i < 30; ++i) key('+');
  seen.near = side(), seen.nearest = element('status').textContent;
  for (let i = 0; i < 45; ++i) key('-');
  seen.far = norm(viewer.view.centre), seen.farthest = element('status').textContent;
  key('0'); await rest();
  let frames = 0;
  const draw = viewer.draw;
  viewer.draw = now => { ++frames; draw.call(viewer, now); };
  await pause(500);
  const {cloud} = viewer.renderer.runs[0];
  await patiently((async () => { for (let i = 0; i < 50 && (cloud.sorting || viewer.asked); ++i) await pause(20); })());
  frames = 0;
  await pause(500);
  seen.frames = frames;
  HTMLAnchorElement.prototype.click = function() { seen.file = this.download; };
  HTMLCanvasElement.prototype.toBlob = function(done) {
    const [x, y] = pixel(A), scale = this.width / innerWidth;
    seen.pixel = this.getContext('2d').getImageData(Math.round(x * scale), Math.round(y * scale), 1, 1).data[0];
    done(new Blob());
  };
  key('i');
  const out = document.createElement('pre');
  out.id = 'seen';
  out.textContent = JSON.stringify(seen);
  document.body.append(out);
}
</script>)JS";
    const Vec3f normal = normalize(Vec3f{0.5f, -0.3f, 1}),
                across = normalize(cross(Vec3f{0, 1, 0}, normal)), down = cross(normal, across),
                middle = -0.7f * normal;  // in front of the pivot of the first view
    const auto list = [](Vec3f v) { return str("[", v.x, ",", v.y, ",", v.z, "]"); };
    const std::string points =
        str("<script>const points = [", list(middle + 0.5f * across - 0.3f * down), ",",
            list(middle + 0.4f * down - 0.6f * across), ",", list(normal), "];</script>");
    std::vector<ViewRun> runs;
    runs.push_back(plane_run(middle, across, down, normal));
    std::string page =
        view_page({std::move(runs), two_cameras(), {10, 0, 0}, /*metres=*/true}).html;
    const fs::path file = folder("points") / "page.html";
    write_text_file(file, page.insert(page.rfind("</body>"), points + script));
    const std::string html = page_in_browser(file, "?wait&show=bogus&camera=99&zoom=2",
                                             "--window-size=420,420"),
                      text = text_of(html, "seen");
    ASSERT_FALSE(text.empty()) << text_of(html, "status")
                               << contents(file.parent_path() / "err.txt");
    const JsonValue seen = parse_json_value(text, "seen");
    const auto number = [&](const char* name) { return seen[name].number_or(1e9); };
    const auto says = [&](const char* name, const char* words) {
        EXPECT_NE(seen[name].text.find(words), std::string::npos)
            << name << ": " << seen[name].text;
    };
    says("status", "Not understood in the address, and left out: show=bogus, camera=99.");
    EXPECT_EQ(seen["mode"].text, "splats");
    // A pixel is 0.01 wide. Splats behind the surface would add 0.3.
    EXPECT_LT(number("distances"), 1e-3);
    EXPECT_LT(number("places"), 1e-3);
    EXPECT_LT(number("distancem"), 1e-3);
    EXPECT_LT(number("placem"), 1e-3);
    says("textm", " metres.");
    EXPECT_LT(number("pivot"), 1e-3);
    EXPECT_LT(number("turned"), 0.1) << "px: the view turns about the point that was clicked";
    says("cut", "No surface here");
    EXPECT_EQ(seen["box"].text.find("8."), 0u) << "in the scene's frame: " << seen["box"].text;
    EXPECT_EQ(seen["unread"].text, "");
    EXPECT_LT(number("link"), 1e-4);
    EXPECT_EQ(seen["linked"].text, "grey,true");
    EXPECT_EQ(seen["bad"].text, "camera=1.5,view=1,0,0,0,0,0,0,0,0,0,0,0,zoom=-1,box=1,1,1,0,2,2");
    EXPECT_NEAR(number("zoom"), 3, 1e-6);
    EXPECT_GT(number("near") * number("before"), 0) << "in front of the surface";
    EXPECT_LT(std::abs(number("near")), 0.2 * std::abs(number("before")));
    says("nearest", "nearest view");
    EXPECT_LT(number("far"), 25);
    says("farthest", "farthest view");
    EXPECT_EQ(number("frames"), 0) << "drawn at rest";
    EXPECT_EQ(seen["file"].text, "run-splats.png");
    EXPECT_GT(number("pixel"), 100);
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
    std::string page = view_page({std::move(runs), two_cameras()}).html;
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
    options.follow = true;
    const Vec3d origin{7, 0, -1};  // of the page's frame; the snapshots' is at 7 0 0
    std::string page = view_page({std::move(runs), two_cameras(), origin}, options).html;
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
