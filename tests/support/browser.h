// Pages in a browser without a screen.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "io/files/json_value.h"
#include "support/command.h"

namespace tvsgs {

inline std::string decoded_base64(const std::string& text) {
    std::string bytes;
    unsigned bits = 0;
    int count = 0;
    for (const char c : text) {
        const int digit = c >= 'A' && c <= 'Z'   ? c - 'A'
                          : c >= 'a' && c <= 'z' ? c - 'a' + 26
                          : c >= '0' && c <= '9' ? c - '0' + 52
                          : c == '+'             ? 62
                          : c == '/'             ? 63
                                                 : -1;
        if (digit < 0) continue;
        bits = bits << 6 | static_cast<unsigned>(digit), count += 6;
        if (count >= 8) count -= 8, bytes += static_cast<char>(bits >> count & 255);
    }
    return bytes;
}

/// What stands in the element of that id; empty: there is none.
inline std::string text_of(const std::string& html, const std::string& id) {
    const std::size_t at = html.find("id=\"" + id + "\"");
    if (at == std::string::npos) return "";
    const std::size_t from = html.find('>', at) + 1;
    return html.substr(from, html.find("</", from) - from);
}

/// The name of a Chromium that starts here; empty: there is none.
inline const std::string& chromium() {
    static const std::string found = [] {
        for (const std::string name : {"chromium", "chromium-browser", "google-chrome"})
            if (std::system(("command -v " + name + " >/dev/null && timeout 60 " + name +
                             (geteuid() == 0 ? " --no-sandbox" : "") +
                             " --headless=new --dump-dom about:blank >/dev/null 2>&1")
                                .c_str()) == 0)
                return name;
        return std::string();
    }();
    return found;
}

/// A page as it is when its scripts have run. `folder`: for the browser's own files.
inline std::string document_in_browser(const std::filesystem::path& folder,
                                       const std::string& url,
                                       const std::string& flags = "") {
    const Result result = run_script(
        folder, "timeout 200 " + chromium() + (geteuid() == 0 ? " --no-sandbox" : "") +
                    " --headless=new --use-angle=swiftshader --enable-unsafe-swiftshader "
                    "--force-device-scale-factor=1 --virtual-time-budget=60000 --dump-dom "
                    "--user-data-dir='" +
                    (folder / "profile").string() + "' " + flags + " '" + url +
                    "' >out.txt 2>err.txt");
    EXPECT_EQ(result.code, 0) << result;
    return result.out;
}

/// `query`: begins with "?", or empty.
inline std::string page_in_browser(const std::filesystem::path& page,
                                   const std::string& query,
                                   const std::string& flags = "") {
    return document_in_browser(page.parent_path(), "file://" + page.string() + query, flags);
}

/// What the page's test mode says: {"width", "height", "bits", "error", "renderer", "pixels"}.
inline JsonValue test_of_page(const std::filesystem::path& page,
                              const std::string& query,
                              const std::string& flags = "") {
    const std::string html = page_in_browser(page, query, flags), text = text_of(html, "result");
    EXPECT_FALSE(text.empty()) << text_of(html, "status") << "\n"
                               << contents(page.parent_path() / "err.txt");
    return text.empty() ? JsonValue() : parse_json_value(text, "result");
}

}  // namespace tvsgs
