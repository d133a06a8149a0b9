// The texts of src/report/view, which a page of tvsgs-view consists of.
#pragma once

namespace tvsgs {

extern const char* const kViewPage;    // page.html, with places to fill: {{name}}
extern const char* const kViewStyle;   // page.css
extern const char* const kViewScript;  // the scripts, in their order

}  // namespace tvsgs
