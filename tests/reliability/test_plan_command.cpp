// The plan as a user meets it: printed, pinned, kept, and the two ways to end a run by time.
#include <regex>

#include "pipeline/scene/planned_scene.h"
#include "plan/decide.h"
// Its `json` would be shadowed.
#include "command_test.h"

namespace tvsgs {
namespace {

class PlanCommand : public CommandTest {
protected:
    static json resolved(const std::string& run) { return json::parse(read(run + "/config.json")); }
    static std::vector<json> events(const std::string& run, const std::string& event) {
        std::vector<json> found;
        std::istringstream log(read(run + "/log.jsonl"));
        for (std::string line; std::getline(log, line);)
            if (json entry = json::parse(line); entry.value("event", "") == event)
                found.push_back(entry);
        return found;
    }
};

TEST_F(PlanCommand, PrintsAndStops) {
    const Result plan = call("train", "--scene scene --device cpu --plan --quiet");
    ASSERT_EQ(plan.code, 0) << plan;
    for (const char* part :
         {"scene ", "8 training and 0 test photographs", "preset ", "few photographs",
          "fewer than 40", "none needed", "(densify.enabled)", "exposure"})
        EXPECT_NE(plan.out.find(part), std::string::npos) << part << "\n" << plan.out;
    const std::string coverage = "start points per textured pixel: they cover the scene";
    const std::size_t first = plan.out.find(coverage);
    ASSERT_NE(first, std::string::npos) << plan.out;
    EXPECT_EQ(plan.out.find(coverage, first + 1), std::string::npos) << "said once: " << plan.out;
    EXPECT_FALSE(fs::exists(folder_ / "runs")) << "nothing is written";
}

/// The number before `unit` behind `label`.
double number_in(const std::string& text, const std::string& label, const std::string& unit) {
    std::smatch found;
    const std::regex pattern(label + " ([0-9.]+) " + unit);
    return std::regex_search(text, found, pattern) ? std::stod(found[1]) : -1;
}

TEST_F(PlanCommand, SaysMemoryAndTimeThatTheRunKeepsTo) {
    const std::string flags = "--scene scene --device cpu --iterations 20 ";
    const Result plan = call("train", flags + "--plan --quiet");
    ASSERT_EQ(plan.code, 0) << plan;
    const double megabytes = number_in(plan.out, "memory:", "MB of [0-9.]+ GB for");
    ASSERT_GT(megabytes, 0) << plan.out;
    const Result trained = call("train", flags + "--out costs");
    ASSERT_EQ(trained.code, 0) << trained;
    EXPECT_NEAR(number_in(trained.err, "CPU,", "MB of memory"), megabytes, 1) << "the same number";
    EXPECT_TRUE(trained.says("Plan: few photographs; ")) << trained;
    EXPECT_FALSE(trained.says("fewer than 40")) << "reasons are for --plan: " << trained;
    const json done = last_line("costs"), told = json::parse(read("costs/memory.json"));
    const auto splats = done["gaussians"].get<double>();
    EXPECT_EQ(told["first_splats"], splats);
    EXPECT_NEAR(told["host"]["first_bytes"].get<double>(), 1e6 * megabytes, 0.6e6);
    const auto peak = done["peak_bytes"].get<double>(),
               device = told["device"]["first_bytes"].get<double>();
    EXPECT_LE(peak, device) << plan.out;
    EXPECT_GE(peak, 0.25 * device) << "no idle promise";
    // The structure alone: how fast the machine is at another time is its own affair.
    const std::regex time(
        "time: about [0-9]+ (s|min) to [0-9]+ (s|min) for 20 iterations; [0-9]+ took [0-9.]+ ms "
        "each just now, (in all phases|before later phases)");
    EXPECT_TRUE(std::regex_search(plan.out, time)) << plan.out;
    // Before stereo has made a cloud there is nothing to go by.
    const Result stereo =
        call("train", "--scene scene --device cpu --plan --quiet --set init.min_points=100000");
    EXPECT_NE(stereo.out.find("memory and time: not known before stereo"), std::string::npos)
        << stereo.out;
    EXPECT_EQ(stereo.out.find("time: about"), std::string::npos) << stereo.out;
    EXPECT_TRUE(std::regex_search(plan.out, std::regex("\nmachines +CPU "))) << plan.out;
    EXPECT_EQ(json::parse(read("costs/plan.json"))["decisions"].back()["name"], "machines");
    // A little less than what the training takes: compact lists, unless the user wants others.
    const json host = json::parse(read("costs/memory.json"))["host"];
    const auto bytes = host["first_bytes"].get<std::int64_t>() - 100 * std::llround(splats);
    const std::string less = flags + "--plan --quiet --host-memory " + std::to_string(bytes);
    const Result compact = call("train", less),
                 pinned = call("train", less + " --set tv.lists=full");
    EXPECT_EQ(compact.code, 0) << compact;
    EXPECT_TRUE(std::regex_search(compact.out, std::regex("machines +compact lists ")))
        << compact.out;
    EXPECT_NE(compact.out.find("(tv.lists)"), std::string::npos) << compact.out;
    EXPECT_EQ(pinned.code, 4) << pinned;
    EXPECT_TRUE(std::regex_search(pinned.out, std::regex("machines +blocks "))) << pinned.out;
    EXPECT_TRUE(pinned.says("tvsgs-blocks split --scene scene")) << pinned;
    const Result full = call("train", flags + "--plan --quiet --host-memory 1M");
    EXPECT_EQ(full.code, 4) << full;
    EXPECT_NE(full.out.find("preset"), std::string::npos) << "the plan is said before";
}

TEST_F(PlanCommand, WhatTheUserSetsStays) {
    const Result plan = call("train",
                             "--scene scene --device cpu --plan --quiet --iterations 700 --set "
                             "densify.enabled=true");
    ASSERT_EQ(plan.code, 0) << plan;
    EXPECT_NE(plan.out.find("[densify.enabled stays true by --set]"), std::string::npos)
        << plan.out;
    EXPECT_TRUE(std::regex_search(plan.out, std::regex("iterations +700 "))) << plan.out;
    EXPECT_NE(plan.out.find("[iterations stays 700 by the command line]"), std::string::npos)
        << plan.out;
    // One key of several.
    const Result partly =
        call("train",
             "--scene scene --device cpu --plan --quiet --set loss.normal.weight=1 "
             "--set lr.position_max_steps=4000");
    EXPECT_NE(partly.out.find("(iterations, model.sh_every, loss.photometric.exposure_start, ...)  "
                              "[lr.position_max_steps stays 4000 by --set]"),
              std::string::npos)
        << partly.out;
    const Result unplanned =
        call("train", "--scene scene --device cpu --plan --quiet --config " TVSGS_SOURCE_DIR
                      "/configs/pgsr_sparse.json");
    EXPECT_NE(unplanned.out.find("is not planned"), std::string::npos) << unplanned.out;
    EXPECT_EQ(call("train", "--scene scene --resume nothing --plan").code, 2);
    const Result mesh =
        call("train", "--scene scene --device cpu --plan --set mesh.method=tetrahedron");
    EXPECT_EQ(mesh.code, 2) << "what the next command would refuse: " << mesh;
}

TEST_F(PlanCommand, AutoLeavesTheChoiceToIt) {
    const auto plan = [&](const std::string& flags) {
        const Result r = call("train", "--scene scene --device cpu --plan --quiet " + flags);
        EXPECT_EQ(r.code, 0) << r;
        return r.out.substr(0, r.out.find("\nmachines "));  // memory and time of the moment
    };
    const std::string planned = plan("");
    EXPECT_NE(planned.find(", loss.photometric.masks)"), std::string::npos) << planned;
    EXPECT_EQ(plan("--mask-use auto"), planned);
    EXPECT_EQ(plan("--set loss.photometric.masks=auto"), planned);
    EXPECT_NE(
        plan("--mask-use none").find("[loss.photometric.masks stays none by the command line]"),
        std::string::npos);
}

TEST_F(PlanCommand, GoesByTheCoverageThatIsGiven) {
    const auto given = [&](const std::string& coverage) {
        const Result plan = call("train",
                                 "--scene scene --device cpu --plan --quiet --set "
                                 "init.min_points=0 --set plan.coverage=" +
                                     coverage);
        EXPECT_EQ(plan.code, 0) << plan;
        return plan.out;
    };
    const std::string none = given("0"), measured = given("-1");
    EXPECT_NE(none.find("from plan.coverage; measured "), std::string::npos) << none;
    EXPECT_TRUE(std::regex_search(none, std::regex("new splats +yes "))) << none;
    EXPECT_TRUE(std::regex_search(measured, std::regex("new splats +none needed "))) << measured;
    EXPECT_EQ(measured.find("plan.coverage"), std::string::npos) << measured;
}

TEST_F(PlanCommand, VotingThatIsTurnedOffTakesItsLossesAlong) {
    const Result off = call(
        "train", "--scene scene --device cpu --iterations 6 --set tv.enabled=false --out no_votes");
    EXPECT_EQ(off.code, 0) << off;
    for (const char* loss : {"tv_normal", "tv_position"})
        EXPECT_EQ(resolved("no_votes")["loss"][loss]["weight"], 0) << loss;
    EXPECT_EQ(call("train",
                   "--scene scene --device cpu --config no_votes/config.json --out no_votes_again")
                  .code,
              0);
    const Result torn = call(
        "train",
        "--scene scene --device cpu --plan --set tv.enabled=false --set loss.tv_normal.weight=1");
    EXPECT_EQ(torn.code, 2) << torn;
}

TEST_F(PlanCommand, IsKeptWithTheRunWhichItsConfigurationRepeats) {
    const Result planned = call("train", "--scene scene --device cpu --iterations 6 --out planned");
    ASSERT_EQ(planned.code, 0) << planned;
    const json plan = json::parse(read("planned/plan.json"));
    ASSERT_GE(plan["decisions"].size(), 4u);
    for (const json& decision : plan["decisions"])
        for (const auto& [key, value] : decision["settings"].items()) {
            const json found = resolved("planned").at(
                json::json_pointer("/" + std::regex_replace(key, std::regex("\\."), "/")));
            EXPECT_EQ(found.is_string() ? found.get<std::string>() : found.dump(), value) << key;
        }
    EXPECT_EQ(resolved("planned")["plan"]["enabled"], false);
    EXPECT_EQ(resolved("planned")["backbone"], "ewa");
    ASSERT_EQ(call("train", "--config planned/config.json --device cpu --out again").code, 0);
    EXPECT_FALSE(fs::exists(folder_ / "again/plan.json"));
    EXPECT_EQ(splats("planned"), splats("again"));
    const Result pinned = call(
        "train", "--scene scene --device cpu --iterations 6 --out pinned --config " TVSGS_SOURCE_DIR
                 "/configs/pgsr_sparse.json");
    ASSERT_EQ(pinned.code, 0) << pinned;
    EXPECT_FALSE(fs::exists(folder_ / "pinned/plan.json")) << "published settings stay as they are";
    EXPECT_EQ(resolved("pinned")["densify"]["enabled"], true);
}

TEST_F(PlanCommand, DecidesAsTheSceneIsMade) {
    const auto planned = [&](const std::string& flags, const std::string& line) {
        const std::string plan =
            call(
                "train",
                "--scene made --device cpu --plan --quiet --force --set init.min_points=0 --eval " +
                    flags)
                .out;
        const std::size_t at = plan.find("\n" + line);
        EXPECT_NE(at, std::string::npos) << line << " is not in\n" << plan;
        std::string choice;
        std::istringstream(plan.substr(at + 1 + line.size())) >> choice;
        return choice;
    };
    const auto decided = [&](const std::string& flags, const std::string& line) {
        const Result made =
            call("synth", "--overwrite --out made --shape torus --width 96 --height 72 " + flags);
        EXPECT_EQ(made.code, 0) << made;
        return planned("", line);
    };
    EXPECT_EQ(decided("--views 8 --arc 90 --exposure-drift 0.1", "exposure"), "no");  // correction
    EXPECT_EQ(decided("--views 8 --arc 90 --exposure-drift 0.4", "exposure"), "fitted");
    EXPECT_EQ(decided("--views 8 --arc 90", "cameras"), "kept");
    EXPECT_EQ(decided("--views 8 --arc 90 --pose-noise 0.2", "cameras"), "kept");
    EXPECT_EQ(decided("--views 8 --arc 90 --pose-noise 2", "cameras"), "refined");
    EXPECT_EQ(decided("--views 6 --arc 60 --points 40", "new splats"), "yes");
    EXPECT_EQ(decided("--views 6 --arc 60 --points 400", "new splats"), "in");
    EXPECT_EQ(decided("--views 6 --arc 60", "multi-view"), "100");
    EXPECT_EQ(decided("--views 6 --arc 200 --elevation-span 0", "multi-view"), "100")
        << "33 degrees";
    EXPECT_EQ(decided("--views 6 --arc 240 --elevation-span 0", "multi-view"), "off")
        << "40 degrees";
    EXPECT_EQ(decided("--views 46 --arc 200 --width 48 --height 36", "preset"), "many")
        << "40 train";
    EXPECT_EQ(planned("--test-every 7", "preset"), "few") << "39 train";
}

TEST_F(PlanCommand, RefinedPosesGoWithTheRun) {
    const Result made = call("synth", "--out off --views 8 --width 48 --height 36 --pose-noise 2");
    ASSERT_EQ(made.code, 0) << made;
    EXPECT_NE(read("off/sparse/0/images.txt"), read("off/gt/sparse/images.txt"));
    const std::string train = "--scene off --split train_all --device cpu --set init.min_points=0 ";
    const auto refined = [&](const std::string& run) { return read(run + "/cameras/images.txt"); };
    const Result whole = call("train", train + "--iterations 40 --out whole --checkpoint-every 15");
    ASSERT_EQ(whole.code, 0) << whole;
    EXPECT_TRUE(whole.says("Refined poses: turned by")) << whole;
    EXPECT_EQ(last_line("whole")["cameras"]["views"].size(), 7u);
    EXPECT_GT(last_line("whole")["cameras"]["views"]["0000.png"]["turn_px"], 0.0);

    const Result rest = call("train",
                             "--device cpu --resume whole/checkpoints/iteration_30.ckpt "
                             "--out rest");
    ASSERT_EQ(rest.code, 0) << rest;
    EXPECT_EQ(refined("rest"), refined("whole")) << "with the same bits";
    EXPECT_EQ(read("rest/cameras.json"), read("whole/cameras.json"));
    EXPECT_EQ(call("train",
                   "--device cpu --resume whole/checkpoints/iteration_30.ckpt --out other "
                   "--set cameras.refine=false")
                  .code,
              2);

    const std::string mesh = "--device cpu --texture none --no-preview --model whole --out ";
    EXPECT_TRUE(call("extract-mesh", mesh + "mesh.ply")
                    .says("uses refined poses for 7 of 7 training views"));
    EXPECT_FALSE(
        call("extract-mesh", mesh + "given.ply --given-cameras").says("uses refined poses"));

    ASSERT_EQ(call("train", train + "--iterations 6 --out given --set cameras.refine=false").code,
              0);
    EXPECT_FALSE(fs::exists(folder_ / "given/cameras"));
    EXPECT_FALSE(last_line("given").contains("cameras"));
    EXPECT_EQ(call("train", train + "--iterations 6 --out none --refine-cameras --set "
                                    "loss.photometric.weight=0")
                  .code,
              2);
}

TEST_F(PlanCommand, ChoosesDiscsWhereTheyAreFastAndNobodyMinds) {
    const auto backbone = [&](bool cuda, const std::vector<std::string>& settings) {
        Configuration asked;
        asked.table.set("scene.path", (folder_ / "scene").string(), "a test");
        asked.table.set("plan.enabled", "true", "a test");
        asked.table.set_all(settings);
        const TrainOptions options = resolve({cuda, ""}, asked, true).options.train;
        EXPECT_EQ(asked.options.plan.enabled, true) << "they stay as asked";
        EXPECT_EQ(options.loss.flatten.weight > 0, options.backbone != kDiscs);
        return options.backbone;
    };
    EXPECT_EQ(backbone(true, {}), kDiscs);
    EXPECT_EQ(backbone(false, {}), "ewa");
    EXPECT_EQ(backbone(true, {"backbone=ewa"}), "ewa");
    EXPECT_EQ(backbone(true, {"loss.flatten.weight=10"}), "ewa");
    EXPECT_EQ(backbone(true, {"loss.flatten.weight=0", "backbone=surfel"}), kDiscs);
    EXPECT_EQ(backbone(true, {"render.depth=plane"}), "ewa");
    EXPECT_EQ(backbone(true, {"render.depth=median", "backbone=surfel"}), kDiscs);
}

TEST_F(PlanCommand, ATimeBudgetFitsTheSchedule) {
    const Result run = call("train",
                            "--scene scene --device cpu --iterations 1000000 --time-budget 1.5 "
                            "--out timed");
    ASSERT_EQ(run.code, 0) << run;
    const auto fits = events("timed", "plan");
    ASSERT_GE(fits.size(), 1u) << run;
    EXPECT_LT(fits.back()["iterations"], 1000000);
    const json done = last_line("timed");
    EXPECT_EQ(done["event"], "done");
    EXPECT_EQ(done["iteration"], fits.back()["iterations"]);
    EXPECT_EQ(resolved("timed")["iterations"], done["iteration"]) << "what was run";
    EXPECT_LT(resolved("timed")["lr"]["position_max_steps"], 1000000);
    EXPECT_EQ(resolved("timed")["plan"]["time_budget"], 0) << "to be run again as it was";
    // A run that goes on has the time that is given to it then.
    const Result on =
        call("train", "--device cpu --resume timed --iterations 1000000 --time-budget 0.5");
    ASSERT_EQ(on.code, 0) << on;
    EXPECT_GT(last_line("timed")["iteration"], done["iteration"]);
    EXPECT_LT(last_line("timed")["iteration"], 1000000);
}

TEST_F(PlanCommand, UntilConvergedStopsWhereTestViewsOrTheSurfaceStandStill) {
    const std::string rates =
        "--set lr.position_start=0 --set lr.position_end=0 --set lr.sh_dc=0 --set lr.sh_rest=0 "
        "--set lr.opacity=0 --set lr.scale=0 --set lr.rotation=0";
    const std::string converged =
        "--device cpu --until converged --iterations 100000 --checkpoint-every 0 ";
    const Result scored = call("train", "--scene scene --eval --out scored " + converged + rates);
    ASSERT_EQ(scored.code, 0) << scored;
    EXPECT_TRUE(scored.says("Converged: the best PSNR")) << scored;
    EXPECT_EQ(last_line("scored")["event"], "done");
    EXPECT_LT(last_line("scored")["iteration"], 100000);

    const Result still =
        call("train", "--scene scene --views 0,1,2 --out still " + converged + rates);
    ASSERT_EQ(still.code, 0) << still;
    EXPECT_TRUE(still.says("Converged: in the last 100 iterations half of the surface moved"))
        << still;
    EXPECT_EQ(last_line("still")["iteration"], 200) << "the second look";
    // A surface that moves ends with its iterations.
    const Result moves = call("train",
                              "--scene scene --views 0,1,2 --device cpu --until converged "
                              "--iterations 210 --out moves --set lr.position_start=1e-3");
    ASSERT_EQ(moves.code, 0) << moves;
    EXPECT_EQ(last_line("moves")["iteration"], 210);
    // The same line starts a run as it goes on with one.
    ASSERT_EQ(train("--scene scene --out anew --resume").code, 0);
    EXPECT_TRUE(fs::exists(folder_ / "anew/plan.json"));
}

}  // namespace
}  // namespace tvsgs
