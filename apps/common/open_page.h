// Opens a page in the browser of the desktop.
#pragma once

#include <string>

namespace tvsgs {

/// Opens a file with xdg-open (freedesktop.org). Warns where that fails; waits for a failure for
/// two seconds at most.
void open_page(const std::string& page);

}  // namespace tvsgs
