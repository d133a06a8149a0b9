#include "apps/common/command_line.h"
#include "apps/train/command.h"

int tvsgs::command(int argc, char** argv) {
    return train_command(argc, argv);
}
