// tvsgs-train: scene in, splats out.
#include "apps/common/command_line.h"
#include "apps/train/command.h"

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::train_command(argc, argv); });
}
