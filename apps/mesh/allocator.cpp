// How jemalloc works for this program, whose arrays of hundreds of megabytes come and go stage by
// stage: with pages of 2 MiB, which it keeps. Else the threads queue for 4 KiB pages that the
// system has to clear, in a third of the time.

extern "C" {
extern const char*
    malloc_conf;  // jemalloc looks for it by this name; the variable MALLOC_CONF has the last word
const char* malloc_conf = "thp:always,dirty_decay_ms:-1,muzzy_decay_ms:-1";
}
