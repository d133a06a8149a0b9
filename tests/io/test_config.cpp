#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>

#include "io/config/config.h"
#include "io/io_test.h"

namespace tvsgs {
namespace {

enum class Map { covariant, unit_length };

struct Inner {
    float weight = 0.05f, tiny = 1e-7f;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1}, "weight of the term");
        field("tiny", tiny, {0, 1e30}, "a small number");
    }
};

struct TestOptions {
    int refresh_every = 100;
    std::int64_t seed = 7;
    float range = 0.1f;
    bool whiten = true;
    std::string name = "a \"name\"";
    Map map = Map::covariant;
    Inner photometric;

    template <class Visitor>
    void fields(Visitor& field) {
        field("refresh_every", refresh_every, {1, 1000}, "steps between votes");
        field("seed", seed, {0, 9e15}, "seed");
        field("range", range, {0.1f, 0.7f}, "reach");
        field("whiten", whiten, "votes in whitened space");
        field("name", name, "what to call it");
        field.choice("map", map, {"covariant", "unit_length"}, "which map");
        field.group("photometric", photometric, "colours");
    }
};

class Config : public IoTest {
protected:
    TestOptions options;
    OptionTable table;

    void SetUp() override {
        IoTest::SetUp();
        table.add("tv", options);
    }
    void read(const std::string& json) { table.read_file(write("config.json", json)); }
    void expect_usage_error(const std::string& text, const std::string& json) {
        expect_error(ExitCode::usage, text, [&] { read(json); });
    }
};

TEST_F(Config, NestedAndDottedKeys) {
    read(R"({"comment": "any", "info": {"version": 1},
             "tv": {"refresh-every": 5, "comment": [1], "photometric": {"weight": 1}},
             "tv.seed": 9000000000000000, "tv.map": "unit-length"})");
    EXPECT_EQ(options.refresh_every, 5);
    EXPECT_EQ(options.photometric.weight, 1);
    EXPECT_EQ(options.seed, 9000000000000000);
    EXPECT_EQ(options.map, Map::unit_length);
    EXPECT_EQ(options.range, 0.1f);
}

TEST_F(Config, LaterSourcesWin) {
    read(R"({"tv": {"refresh_every": 5, "seed": 1, "whiten": false}})");
    read(R"({"tv": {"refresh_every": 6, "seed": 2}})");
    setenv("TVSGS_TV__REFRESH_EVERY", "8", 1);
    setenv("TVSGS_TV__PHOTOMETRIC__WEIGHT", "0.5", 1);
    table.read_environment();
    unsetenv("TVSGS_TV__REFRESH_EVERY"), unsetenv("TVSGS_TV__PHOTOMETRIC__WEIGHT");
    table.set("tv.refresh-every", "9", "--set");
    EXPECT_EQ(options.refresh_every, 9);
    EXPECT_EQ(options.seed, 2);
    EXPECT_FALSE(options.whiten);
    EXPECT_EQ(options.photometric.weight, 0.5f);
}

TEST_F(Config, UnknownKeysNameTheNearest) {
    expect_usage_error(
        "config.json: unknown key 'tv.refresh_evry'; did you mean 'tv.refresh_every'?",
        R"({"tv": {"refresh_evry": 5}})");
    expect_usage_error("unknown key 'tw.seed'; did you mean 'tv.seed'?", R"({"tw": {"seed": 5}})");
    expect_usage_error("unknown key 'xyzzy'", R"({"xyzzy": {}})");
    expect_usage_error("unknown key 'tv.info'", R"({"tv": {"info": 1}})");
    expect_error(ExitCode::usage, "--set: unknown key 'tv.sed'",
                 [&] { table.set("tv.sed", "1", "--set"); });
}

TEST_F(Config, DuplicateKeys) {
    expect_usage_error("'seed' is given twice", R"({"tv": {"seed": 1, "seed": 2}})");
    expect_usage_error("'tv' is given twice", R"({"tv": {"seed": 1}, "tv": {"range": 0.2}})");
    expect_usage_error("'tv.seed' is given twice", R"({"tv": {"seed": 1}, "tv.seed": 2})");
    expect_usage_error("is given twice", R"({"tv": {"refresh_every": 1, "refresh-every": 2}})");
}

TEST_F(Config, LaterBasesWinAndOwnKeysWinOverThem) {
    write("first.json", R"({"tv": {"refresh_every": 5, "seed": 5, "range": 0.5}})");
    write("below/second.json", R"({"extends": "deep/third.json", "tv": {"refresh_every": 6}})");
    write("below/deep/third.json", R"({"tv": {"refresh_every": 7, "seed": 7, "name": "third"}})");
    const std::string own =
        R"({"extends": ["first.json", "below/second.json"], "tv": {"seed": 8, "whiten": false}})";
    read(own);
    EXPECT_EQ(options.refresh_every, 6);
    EXPECT_EQ(options.seed, 8);
    EXPECT_EQ(options.range, 0.5f);
    EXPECT_EQ(options.name, "third");
    EXPECT_FALSE(options.whiten);
    EXPECT_EQ(table.option("tv.name").source, (folder / "config.json").string());
    EXPECT_EQ(table.json().find("extends"), std::string::npos);

    // Existing keys win over keys that are read below them.
    TestOptions others;
    OptionTable other;
    other.add("tv", others);
    other.set("tv.whiten", "true", "--set");
    other.read_text((folder / "config.json").string(), own, /*below=*/true);
    EXPECT_EQ(others.refresh_every, 6);
    EXPECT_EQ(others.seed, 8);
    EXPECT_EQ(others.name, "third");
    EXPECT_TRUE(others.whiten);
}

TEST_F(Config, BasesThatCannotBeReadAreNamed) {
    expect_usage_error("no.json: ", R"({"extends": "no.json"})");
    expect_usage_error("while reading the base of " + (folder / "config.json").string(),
                       R"({"extends": "no.json"})");
    expect_usage_error("no configuration is called 'pgsr_spars'; did you mean 'pgsr_sparse'?",
                       R"({"extends": "pgsr_spars"})");
    expect_usage_error("extends = 5: expected a configuration's name", R"({"extends": 5})");
    expect_usage_error("extends = [\"a.json\",null]", R"({"extends": ["a.json", null]})");
    expect_usage_error("unknown key 'tv.extends'", R"({"tv": {"extends": "a.json"}})");
    expect_usage_error("configs/auto.json: unknown key 'plan.enabled'", R"({"extends": "auto"})");
    write("base.json", R"({"tv": {"seed": "x"}})");
    expect_usage_error("base.json: tv.seed = \"x\": expected a whole number",
                       R"({"extends": "base.json"})");
    write("base.json", R"({"tv": {"seed": 1}, "tv.seed": 2})");
    expect_usage_error("base.json: key 'tv.seed' is given twice", R"({"extends": "base.json"})");
}

TEST_F(Config, BasesThatExtendEachOtherAreRefused) {
    expect_usage_error("config.json: extends 'config.json', which extends this file",
                       R"({"extends": "config.json"})");
    write("a.json", R"({"extends": "b.json"})");
    write("b.json", R"({"extends": "./config.json"})");
    expect_usage_error("b.json: extends './config.json', which extends this file",
                       R"({"extends": "a.json"})");
    write("b.json", R"({"tv": {"seed": 3}})");
    read(R"({"extends": ["a.json", "b.json"]})");
    EXPECT_EQ(options.seed, 3);
}

TEST_F(Config, WrongTypesAndValues) {
    for (const char* value : {"\"5\"", "5.5", "true", "null", "[5]", "0", "1001", "1e30", "-1"})
        expect_usage_error("tv.refresh_every", str("{\"tv\": {\"refresh_every\": ", value, "}}"));
    expect_usage_error("a whole number, 1 to 1,000", R"({"tv": {"refresh_every": 0}})");
    for (const char* value : {"1", "\"true\""})
        expect_usage_error("true or false", str("{\"tv.whiten\": ", value, "}"));
    expect_usage_error("one of covariant, unit_length", R"({"tv.map": "other"})");
    expect_usage_error("expected text", R"({"tv.name": 3})");
    expect_usage_error("tv.range", R"({"tv.range": 1e300})");
    for (const char* value :
         {"", " ", "0.2x", "nan", "inf", "1e99", "0x1p-2", "0,2", "0.09", "0.71"})
        expect_error(ExitCode::usage, "--set: tv.range",
                     [&] { table.set("tv.range", value, "--set"); });
    for (const char* value : {"99999999999999999999", "5 6", "--5", "1.5e0", "1e16"})
        expect_error(ExitCode::usage, "--set: tv.seed",
                     [&] { table.set("tv.seed", value, "--set"); });
    EXPECT_EQ(options.seed, 7);
    for (const char* value : {"0.1", "0.7", " 0.25 ", "+0.5"})
        table.set("tv.range", value, "--set");  // both limits belong to the range
    EXPECT_EQ(options.range, 0.5f);
    table.set("tv.whiten", "off", "--set");
    EXPECT_FALSE(options.whiten);
    table.set("tv.whiten", "True", "--set");  // as Python prints it
    EXPECT_TRUE(options.whiten);
}

TEST_F(Config, WholeNumbersMayHaveAnExponent) {
    read(R"({"tv": {"refresh_every": 1e2}})");
    EXPECT_EQ(options.refresh_every, 100);
    table.set("tv.seed", "1e3", "--set");
    EXPECT_EQ(options.seed, 1000);
    EXPECT_EQ(table.option("tv.seed").get(), "1000");
}

/// What the log says while the variables are read.
std::string warnings(OptionTable& table, const OptionTable* others = nullptr) {
    std::ostringstream log;
    const auto usual = spdlog::default_logger();
    spdlog::set_default_logger(std::make_shared<spdlog::logger>(
        "", std::make_shared<spdlog::sinks::ostream_sink_mt>(log)));
    table.read_environment(others);
    spdlog::set_default_logger(usual);
    return log.str();
}

TEST_F(Config, VariablesWithoutAKeyAreAWarning) {
    OptionTable others;
    TestOptions of_others;
    others.add("other", of_others);
    setenv("TVSGS_OTHER__SEED", "8", 1), setenv("TVSGS_TV__SEED", "9", 1);
    EXPECT_NE(warnings(table, &others).find("this command has no key other.seed; ignored"),
              std::string::npos);
    EXPECT_NE(warnings(table).find("TVSGS_OTHER__SEED: unknown key 'other.seed'"),
              std::string::npos);
    unsetenv("TVSGS_OTHER__SEED");
    EXPECT_EQ(warnings(table), "");
    unsetenv("TVSGS_TV__SEED");
    EXPECT_EQ(options.seed, 9);
    EXPECT_EQ(of_others.seed, 7);
}

TEST_F(Config, AJsonErrorNamesItsPlace) {
    expect_usage_error("config.json: line 1, column 17: not valid JSON near `N`",
                       R"({"tv": {"seed": N}})");
    expect_usage_error("line 2, column 8: not valid JSON near `seed`", "{\"tv\":\n {\"a\": seed}}");
    expect_usage_error("line 1, column 8: not valid JSON: the text ends here", "{\"tv\": ");
    expect_usage_error("not valid JSON: a number is too large", R"({"tv.range": 1e999})");
}

TEST_F(Config, WhatIsNoConfiguration) {
    expect_usage_error("not valid JSON", "{\"tv\": ");
    expect_usage_error("not valid JSON", "");
    expect_usage_error("not valid JSON", "{\"tv.name\": \"\xFF\"}");
    expect_usage_error("JSON object", "[1, 2]");
    expect_error(ExitCode::usage, "no.json",
                 [&] { table.read_file((folder / "no.json").string()); });
}

TEST_F(Config, TheResolvedConfigurationReproducesTheValues) {
    options = {999,
               8999999999999999,
               0.333333343f,
               false,
               "k\xC3\xA4se \"\\\n",
               Map::unit_length,
               {0.1f, 1.17549435e-38f}};
    const std::string json = table.json(JsonValue().add("version", "1.2"));
    EXPECT_NE(json.find("\"range\": 0.33333334"), std::string::npos) << json;  // shortest
    TestOptions other;
    OptionTable reader;
    reader.add("tv", other);
    reader.read_file(write("resolved.json", json));
    EXPECT_EQ(other.refresh_every, options.refresh_every);
    EXPECT_EQ(other.seed, options.seed);
    EXPECT_EQ(other.range, options.range);
    EXPECT_EQ(other.whiten, options.whiten);
    EXPECT_EQ(other.name, options.name);
    EXPECT_EQ(other.map, options.map);
    EXPECT_EQ(other.photometric.weight, options.photometric.weight);
    EXPECT_EQ(other.photometric.tiny, options.photometric.tiny);
    EXPECT_EQ(reader.json(JsonValue().add("version", "1.2")), json);
}

TEST_F(Config, EveryFloatComesBack) {
    for (int i = 0; i < 200; ++i) {
        options.photometric.tiny =
            std::ldexp(1.0f + static_cast<float>(i * 7919 % 65537) / 65537.0f, i % 120 - 100);
        const float written = options.photometric.tiny;
        const std::string path = write("c.json", table.json());
        options.photometric.tiny = 0;
        table.read_file(path);
        ASSERT_EQ(options.photometric.tiny, written);
    }
}

TEST_F(Config, HelpNamesEveryOption) {
    const std::string help = table.help();
    for (const Option& option : table.options()) {
        EXPECT_NE(help.find(option.key), std::string::npos);
        EXPECT_NE(help.find(option.help), std::string::npos);
    }
    EXPECT_NE(help.find("1 to 1,000; default 100"), std::string::npos) << help;
    EXPECT_NE(help.find("one of covariant, unit_length; default \"covariant\""), std::string::npos)
        << help;
}

TEST_F(Config, Lists) {
    const auto lists = read_json_lists(
        write("splits.json", R"({"train_3": ["a", 2], "note": "x", "bad": [[1]], "test": []})"));
    ASSERT_EQ(lists.size(), 2u);
    EXPECT_EQ(lists.at("train_3"), (std::vector<std::string>{"a", "2"}));
    expect_error(ExitCode::input, "splits.json",
                 [&] { read_json_lists(write("splits.json", "{")); });
}

TEST(JsonValue, TypesAndEscapes) {
    JsonValue line;
    line.add("i", 3)
        .add("big", std::int64_t{1} << 60)
        .add("b", true)
        .add("t", "a\"\n\x01")
        .add("d", 0.1)
        .add("e", 1e-300);
    line.add("n", std::nan(""))
        .add("inf", -std::numeric_limits<double>::infinity())
        .add("o", JsonValue().add("x", std::vector{1}))
        .add("bad", "\xFF");
    EXPECT_EQ(
        json_text(line),
        R"({"i": 3, "big": 1152921504606846976, "b": true, "t": "a\"\n\u0001", "d": 0.1, "e": 1e-300, )"
        R"("n": null, "inf": null, "o": {"x": [1]}, "bad": ")"
        "\xEF\xBF\xBD"
        R"("})");
    EXPECT_EQ(json_text(JsonValue::object()), "{}");
}

}  // namespace
}  // namespace tvsgs
