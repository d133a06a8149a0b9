#include "eval.h"
namespace tvsgs {
EvalCommand add_eval_tnt(CLI::App& app) {
    return {app.add_subcommand("tnt", "the evaluation of Tanks and Temples"), [] { return 2; }};
}
}  // namespace tvsgs
