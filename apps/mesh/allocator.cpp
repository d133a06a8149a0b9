// How jemalloc works for this program, whose arrays of hundreds of megabytes come and go stage by
// stage: with pages of 2 MiB, which it keeps for half a minute. Else the threads queue for pages of
// 4 KiB, which the system has to clear, for a third of the time.

extern "C" {
extern const char* malloc_conf;  // jemalloc's name; the variable MALLOC_CONF has the last word
const char* malloc_conf = "thp:always,dirty_decay_ms:30000";
}
