// Styles and scripts of report.html and of the pages of tvsgs-view.
#pragma once

namespace tvsgs {

// Files of src/report/view.
extern const char* const kViewPage;    // page.html, with placeholders {{name}}
extern const char* const kViewStyle;   // page.css
extern const char* const kViewScript;  // the scripts, in order

inline constexpr const char* kPageStyle = R"(
:root{color-scheme:light dark;--page:#f4f5f7;--card:#fff;--text:#1b1b1b;--quiet:#55585e;--line:#d5d8dd;--link:#005a9c;--mark:#b35c00}
@media (prefers-color-scheme:dark){:root{--page:#0e1013;--card:#16191d;--text:#e8e8e8;--quiet:#aab0b8;--line:#363c44;--link:#7cc4ff;--mark:#e69f00}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--text);font:16px/1.5 system-ui,-apple-system,"Segoe UI",sans-serif}
main,header{max-width:1240px;margin:0 auto;padding:0 16px}
header{padding-top:20px}h1{font-size:1.6rem;margin:0;overflow-wrap:anywhere}h2{font-size:1.25rem;margin:36px 0 10px}
h3{font-size:1rem;margin:18px 0 6px;overflow-wrap:anywhere}p{margin:6px 0 10px;max-width:75ch}
a{color:var(--link)}.quiet{color:var(--quiet)}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:2px 18px;margin:10px 0 0;padding:0}nav a{display:inline-block;padding:5px 0}
.notice{border-left:4px solid #d55e00;background:var(--card);padding:8px 12px;max-width:none}
.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(132px,1fr));gap:10px;margin:16px 0}
.facts div{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:8px 12px}
.facts dt{font-size:.82rem;color:var(--quiet)}.facts dd{margin:0;font-size:1.2rem;font-weight:600;overflow-wrap:anywhere}
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,420px),1fr));gap:14px;align-items:start}
figure{margin:0;min-width:0}.card{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:10px}
svg.plot{display:block;width:100%;height:auto}
details{margin-top:6px}summary{cursor:pointer;color:var(--link);padding:6px 0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:3px 10px;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}.words td,.words th{text-align:left;white-space:normal;overflow-wrap:anywhere}
.plan td,.plan th{text-align:left;white-space:normal;overflow-wrap:break-word}
caption{text-align:left;color:var(--quiet);padding-bottom:4px}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(46%,210px),1fr));gap:8px}
.pictures img{width:100%;height:auto;display:block;background:#101010;border-radius:3px}
figcaption{font-size:.86rem;color:var(--quiet);padding-top:3px}
.lead{font-size:1.08rem}.level{display:inline-block}main>ul{margin:4px 0 12px;padding-left:22px;max-width:75ch}li{margin:3px 0;overflow-wrap:anywhere}
.viewer img{width:100%;max-width:900px;height:auto;max-height:92vh;object-fit:contain;object-position:left;display:block;border-radius:4px}
.viewer iframe{width:100%;height:92vh;min-height:420px;border:0;display:block}
.scroll:focus-visible,iframe:focus-visible,button:focus-visible,a:focus-visible,summary:focus-visible,input:focus-visible{outline:3px solid var(--mark);outline-offset:2px}
.controls{display:flex;flex-wrap:wrap;gap:6px;margin:8px 0}.controls[hidden]{display:none}
button{font:inherit;min-width:44px;min-height:40px;padding:4px 12px;background:var(--card);color:var(--text);border:1px solid var(--quiet);border-radius:5px;cursor:pointer}
.scale{display:grid;grid-template-columns:auto minmax(60px,240px) auto;gap:8px;align-items:center;justify-content:start;font-size:.86rem;margin-top:8px}
.scale[hidden]{display:none}.scale i{display:block;height:14px;border-radius:2px;print-color-adjust:exact;-webkit-print-color-adjust:exact}
footer{max-width:1240px;margin:36px auto 0;padding:0 16px 28px;color:var(--quiet);font-size:.86rem}
@media screen and (max-width:600px){svg.plot{font-size:15px}svg.plot .title{font-size:17px}main,header{padding:0 10px}.card{padding:4px}.card summary,figcaption{padding-left:6px}}
@media print{:root{color-scheme:light;--page:#fff;--card:#fff;--text:#000;--quiet:#333;--line:#ccc;--link:#000}
body{font-size:10.5pt}nav,.controls,button,details{display:none!important}.viewer img{max-width:12cm}
main,header,footer{max-width:none;padding:0}.plots{grid-template-columns:1fr 1fr}.pictures{grid-template-columns:repeat(5,1fr)}
figure,.facts div,.view{break-inside:avoid}h2,h3,main>p{break-after:avoid}}
)";

/// Replaces the picture of the 3D view by the view in an iframe: a document of its own, so that its
/// keys and styles do not affect the report. Without scripts the picture stays.
inline constexpr const char* kOpenViewScript = R"JS(
const open = document.getElementById('open-view');
open.addEventListener('click', () => {
  const frame = document.createElement('iframe'), figure = open.closest('figure');
  frame.title = 'View in 3D';
  frame.srcdoc = JSON.parse(document.getElementById('view-page').textContent);
  figure.querySelector('img').replaceWith(frame);
  open.remove();
  frame.focus();
});
)JS";

}  // namespace tvsgs
