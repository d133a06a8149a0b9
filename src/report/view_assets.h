// Texts of the files in src/report/view, from which pages of tvsgs-view are made.
#pragma once

namespace tvsgs {

extern const char* const kViewPage;    // page.html, with placeholders {{name}}
extern const char* const kViewStyle;   // page.css
extern const char* const kViewScript;  // the scripts, in order

}  // namespace tvsgs
