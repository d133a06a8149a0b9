// Tests that each method is self-contained: a loss, a backbone or a mesher is its own files and a
// line in its list, and nothing else in src/ and apps/ uses its type or name
// (docs/develop/add-a-loss.md, docs/develop/add-a-backbone.md). Comments may use any name.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "support/source_text.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct Source {
    std::string path;  // in the repository
    std::string text;

    std::string stem() const { return fs::path(path).stem().string(); }
};

/// Headers in `folder` with this prefix, one per method, and the lists, which alone may include
/// them.
struct Kind {
    std::string folder, prefix;
    std::set<std::string> lists;

    bool has(const Source& s) const {
        return s.path.starts_with(folder) && s.stem().starts_with(prefix) && s.path.ends_with(".h");
    }
};
const std::vector<Kind> kKinds{
    {"src/optim/", "loss_", {"src/optim/losses/losses_list.h"}},
    {"src/render/",
     "backbone_",
     {"src/render/backbones_list.h", "src/render/tiles/fused_gradients.h"}},
    {"src/mesh/", "mesher_", {"src/mesh/meshers_list.h"}}};

/// Types of a method that other files may use: masks, background and exposures of photographs.
const std::set<std::string> kKnownTypes{"PhotometricOptions"};

/// Names of methods: words of file names, identifiers and strings.
const std::set<std::string> kMethods{"pgsr",  "3dgs", "2dgs",    "rade", "radegs",
                                     "fates", "vggs", "fatesgs", "ewa"};
const std::string kAlsoEnglish = "fates";  // also an English word, so only types and files count

/// Exceptions: places where a name may occur, with the reason.
const std::set<std::pair<std::string, std::string>> kAllowed{
    {"src/optim/loop/train.h", "ewa"},   // the default of `backbone` ...
    {"src/optim/loop/train.h", "rade"},  // ... whose help lists all names
    // Built-in configurations have the names of their files.
    {"src/io/config/config.h", "pgsr"},
    // Other ellipse splats find their tiles with the packs of EWA.
    {"src/render/rade/blend_rade.cpp", "ewa"},
};

/// A piece of a source: a word of code, or a whole string.
struct Piece {
    bool string;
    std::string text;
};

bool is_word(char c) {
    return std::isalnum(static_cast<unsigned char>(c)) || c == '_';
}

/// Splits a source into words and strings, without comments.
std::vector<Piece> pieces_of(const std::string& text) {
    std::vector<Piece> pieces;
    const auto after = [&](const std::string& mark, std::size_t from) {
        const std::size_t at = text.find(mark, from);
        return at == std::string::npos ? text.size() : at + mark.size();
    };
    const auto quoted = [&](std::size_t begin) {  // to the character after the closing quote
        std::size_t at = begin + 1;
        while (at < text.size() && text[at] != text[begin]) at += text[at] == '\\' ? 2 : 1;
        return std::min(at + 1, text.size());
    };
    for (std::size_t i = 0; i < text.size();) {
        std::size_t end = i + 1;
        if (text.compare(i, 2, "//") == 0) {
            end = after("\n", i);
        } else if (text.compare(i, 2, "/*") == 0) {
            end = after("*/", i + 2);
        } else if (text.compare(i, 2, "R\"") == 0) {
            const std::size_t open = text.find('(', i);
            end = after(")" + text.substr(i + 2, open - i - 2) + "\"", open);
            pieces.push_back({true, text.substr(open + 1, end - open - 1)});
        } else if (text[i] == '"') {
            end = quoted(i);
            pieces.push_back({true, text.substr(i + 1, end - i - 2)});
        } else if (text[i] == '\'') {
            end = quoted(i);
        } else if (is_word(text[i])) {
            while (end < text.size() && (is_word(text[end]) || text[end] == '\'')) ++end;
            pieces.push_back({false, text.substr(i, end - i)});
        }
        i = end;
    }
    return pieces;
}

/// Words of an identifier, in any case style: "kEwaModel" has k, Ewa, Model.
std::vector<std::string> words_of(const std::string& text) {
    std::vector<std::string> words(1);
    const auto is = [&](int (*kind)(int), std::size_t i) {
        return i < text.size() && kind(static_cast<unsigned char>(text[i])) != 0;
    };
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (!is_word(text[i]) || text[i] == '_') {
            words.emplace_back();
            continue;
        }
        // Splits fooBar and FOOBar; 3DGS is one word.
        if (i > 0 && is(std::isupper, i) && (is(std::islower, i - 1) || is(std::islower, i + 1)))
            words.emplace_back();
        words.back() += text[i];
    }
    std::erase(words, "");
    return words;
}

std::vector<std::string> plain_words_of(const std::string& text) {
    static const std::regex kWord("[A-Za-z0-9]+");
    std::vector<std::string> words;
    for (const auto& m : matches(text, kWord)) words.push_back(m.str());
    return words;
}

std::string lower_case(std::string text) {
    for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

/// Names of methods in a text. Prose in strings cites methods as papers write them; lower case
/// means the name of a part. A path counts by its file, as folders of methods also hold formulas
/// that other files include.
std::set<std::string> methods_in(const std::string& text) {
    std::set<std::string> found;
    for (Piece piece : pieces_of(text)) {
        const bool path =
            piece.string && piece.text.find('/') != std::string::npos && piece.text.ends_with(".h");
        if (path) piece.text = fs::path(piece.text).filename().string();
        const bool prose = piece.string && piece.text.find(' ') != std::string::npos;
        for (const std::string& word : prose ? plain_words_of(piece.text) : words_of(piece.text)) {
            const std::string name = lower_case(word);
            if (!kMethods.contains(name) || (prose && word != name)) continue;
            const bool english = name == kAlsoEnglish && word == name && !path;
            if (!english) found.insert(name);
        }
    }
    return found;
}

/// True if both belong to one method: loss_x.h, loss_x.cpp, loss_x_math.h.
bool same_part(const Source& a, const Source& b) {
    const std::string& s = a.stem().size() < b.stem().size() ? a.stem() : b.stem();
    const std::string& l = a.stem().size() < b.stem().size() ? b.stem() : a.stem();
    return l == s || l.starts_with(s + "_");
}

/// Files that include the header of a method, or use its type, and must not.
std::vector<std::string> types_known_elsewhere(const std::vector<Source>& sources) {
    static const std::regex kDefines(R"((?:^|\n)(?:struct|class|enum class) (\w+)[^;\n]*\{)");
    std::vector<std::string> faults;
    std::map<std::string, std::pair<const Source*, const Kind*>> home;
    for (const Source& s : sources)
        for (const Kind& kind : kKinds)
            if (kind.has(s)) {
                home[s.path.substr(4)] = {&s, &kind};  // as it is included
                for (const auto& m : matches(s.text, kDefines))
                    if (!kKnownTypes.contains(m.str(1))) home[m.str(1)] = {&s, &kind};
            }
    for (const Source& s : sources) {
        std::set<std::string> said;
        for (const Piece& piece : pieces_of(s.text)) {
            const auto at = home.find(piece.text);
            if (at == home.end() || !said.insert(piece.text).second) continue;
            const auto& [owner, kind] = at->second;
            if (!kind->lists.contains(s.path) && !same_part(s, *owner))
                faults.push_back(s.path + ": " + piece.text);
        }
    }
    return faults;
}

/// Files that name a method and must not. `used`: the exceptions that applied.
std::vector<std::string> names_known_elsewhere(
    const std::vector<Source>& sources, std::set<std::pair<std::string, std::string>>& used) {
    std::vector<std::string> faults;
    for (const Source& s : sources) {
        if (std::any_of(kKinds.begin(), kKinds.end(),
                        [&](const Kind& kind) { return kind.lists.contains(s.path); }))
            continue;
        std::set<std::string> own;
        for (const std::string& word : words_of(fs::path(s.path).filename().string()))
            own.insert(lower_case(word));
        for (const std::string& name : methods_in(s.text)) {
            if (own.contains(name)) continue;
            if (kAllowed.contains({s.path, name}))
                used.insert({s.path, name});
            else
                faults.push_back(s.path + ": " + name);
        }
    }
    return faults;
}

const std::vector<Source>& our_sources() {
    static const std::vector<Source> sources = [] {
        static const std::set<std::string> kExtensions{".h", ".cpp", ".cu", ".in"};
        std::vector<Source> all;
        for (const char* folder : {"src", "apps"})
            for (const auto& entry : fs::recursive_directory_iterator(kSource / folder))
                if (kExtensions.contains(entry.path().extension()))
                    all.push_back({fs::relative(entry.path(), kSource), contents(entry.path())});
        std::sort(all.begin(), all.end(),
                  [](const Source& a, const Source& b) { return a.path < b.path; });
        return all;
    }();
    return sources;
}

TEST(Methods, TypesAreKnownToTheirListsAlone) {
    for (const std::string& fault : types_known_elsewhere(our_sources()))
        ADD_FAILURE() << fault << ": only the method's own files and its list may know it";
    for (const Kind& kind : kKinds)
        EXPECT_TRUE(std::any_of(our_sources().begin(), our_sources().end(),
                                [&](const Source& s) { return kind.has(s); }))
            << kind.folder << "*/" << kind.prefix << "*: there is none";
}

TEST(Methods, NamesStandInTheirOwnFilesAndListsAlone) {
    std::set<std::pair<std::string, std::string>> used;
    for (const std::string& fault : names_known_elsewhere(our_sources(), used))
        ADD_FAILURE() << fault
                      << ": methods are named in their own files, lists and configurations";
    for (const auto& [file, name] : kAllowed)
        EXPECT_TRUE(used.contains({file, name})) << file << " no longer names " << name;
}

using Faults = std::vector<std::string>;

TEST(Methods, ATypeThatIsUsedElsewhereIsFound) {
    const Source loss{"src/optim/loss_x.h",
                      "template <class D>\nclass XLoss final : public Loss<D> {\n};\n"};
    const Source list{"src/optim/losses/losses_list.h",
                      "#include \"optim/loss_x.h\"\nXLoss<Cpu> l;\n"};
    const auto with = [&](const std::string& path, const std::string& text) {
        return types_known_elsewhere({loss, list, {path, text}});
    };
    EXPECT_EQ(with("src/optim/loss_x.cpp", "#include \"optim/loss_x.h\"\n"), Faults{});
    EXPECT_EQ(with("src/plan/plan.cpp", "// XLoss, see \"optim/loss_x.h\"\n"), Faults{});
    EXPECT_EQ(with("src/plan/plan.cpp", "#include \"optim/loss_x.h\"\n"),
              Faults{"src/plan/plan.cpp: optim/loss_x.h"});
    EXPECT_EQ(with("src/optim/loss_y.h", "struct Y {\n    XLoss<Cpu> x;\n};\n"),
              Faults{"src/optim/loss_y.h: XLoss"});
    EXPECT_EQ(with("apps/train/tvsgs_train.cpp", "/* none */ XLoss<Cpu> loss;\n"),
              Faults{"apps/train/tvsgs_train.cpp: XLoss"});
}

TEST(Methods, ANameThatIsUsedElsewhereIsFound) {
    const auto in = [](const std::string& text) {
        std::set<std::pair<std::string, std::string>> used;
        return names_known_elsewhere({{"src/plan/plan.cpp", text}}, used).size();
    };
    for (const char* innocent :
         {"// as PGSR's code, 2dgs\n", "/* rade */", "visit(\"flatten\", \"scales, PGSR\");",
          "int count_fates(Fate fates);", "void trade(std::string previewable);",
          "auto n = 1'000; // ewa\n", "char c = '\"'; /* pgsr */ char d = '\"';"})
        EXPECT_EQ(in(innocent), 0u) << innocent;
    for (const char* guilty :
         {"if (name == \"pgsr\") {}", "make<EwaBackbone>();", "bool is_2dgs = false;",
          "struct PGSROptions {};", "#include \"render/rade/blend_rade.h\"", "FatesLoss<Cpu> loss;",
          "#include \"optim/loss_fates.h\"", "R\"json(\"vggs\")json\"", "o.vggs.weight = 1;",
          "field(\"backbone\", b, \"one of ewa, and more\");", "const char* c = \"3DGS\";"})
        EXPECT_EQ(in(guilty), 1u) << guilty;
}

}  // namespace
}  // namespace tvsgs
