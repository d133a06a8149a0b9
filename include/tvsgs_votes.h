/* Tensor voting between the splats of any trainer: a plain C interface of libtvsgs_votes.
 * docs/guide/python.md shows the order of the calls.
 *
 * Functions that return int return 0, or an exit code of the commands (docs/guide/commands.md): 2 wrong use, 4 out of
 * memory, 5 no usable device, 1 any other error. tvsgs_votes_error() then has the text. Calls on one handle wait for
 * each other; different handles are independent. */
#ifndef TVSGS_VOTES_H
#define TVSGS_VOTES_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Changes when a function or a struct changes; the shared library's major version. */
#define TVSGS_VOTES_INTERFACE 1
int tvsgs_votes_interface(void);
/* As "tvsgs 0.1.0". */
const char* tvsgs_votes_version(void);

/* Bits of the flags of a splat. Losses use a splat only with the bit of the loss. */
enum {
    TVSGS_VOTES_HAS_TENSOR = 1,
    TVSGS_VOTES_NORMAL_VALID = 2,
    TVSGS_VOTES_POSITION_VALID = 4
};

/* Parameters of N splats, row by row. On a handle of the CPU all pointers point to host memory. On a handle of a GPU
 * they may point to host or device memory. Only the call reads or writes it. */
typedef struct {
    int64_t count;           /* N, below 2^31 */
    const float* means;      /* [N, 3] world units */
    const float* log_scales; /* [N, 3] log of the standard deviations, world units */
    const float* quats;      /* [N, 4] (w, x, y, z), of any length but zero */
} tvsgs_votes_splats;

/* Results of the last vote; a null pointer leaves an array out. */
typedef struct {
    int64_t count;      /* N of the last vote */
    float* normals;     /* [N, 3] unit, of either sign; zero: none */
    float* targets;     /* [N, 3] places of largest saliency along the normals, world units */
    float* eigenvalues; /* [N, 3] l1 >= l2 >= l3 of the summed votes. Saliency of a surface: l2 - l3, of a curve:
                           l1 - l2, of a point: l3 */
    uint8_t* flags;     /* [N] */
} tvsgs_votes_results;

typedef struct tvsgs_votes tvsgs_votes;

/* Sets *votes to a new handle, or to NULL after an error; tvsgs_votes_error(NULL) then has the text.
 * device: "cpu", "cuda", "cuda:N" or "auto" (the first GPU, else the CPU).
 * options: "KEY=VALUE" with spaces between, as "k=64 targets=anchor", or NULL. Keys are the tv.* keys of tvsgs-train
 * without "tv.", except keys of schedules and fixed voters. */
int tvsgs_votes_create(const char* device, const char* options, tvsgs_votes** votes);
/* NULL is allowed. */
void tvsgs_votes_destroy(tvsgs_votes* votes);

/* Searches the neighbours of the splats. Call it before the first vote, after splats were added, removed or reordered,
 * and now and then while splats move (tvsgs-train: every 100 iterations).
 * parents: [N] index of each splat among the splats of the last refresh, -1 for a new one, or NULL: the splats are the
 * same, in the same order, or, if their number differs, all new. Splats inherit the tensors of their parents.
 * stream: a cudaStream_t of the handle's GPU. The work begins after the earlier work of this stream, and later work of
 * the stream begins after it. A handle of the CPU ignores it. */
int tvsgs_votes_refresh(tvsgs_votes* votes,
                        const tvsgs_votes_splats* splats,
                        const int32_t* parents,
                        void* stream);

/* Runs one voting event on the splats of the last refresh, at their present places. A splat with a number that is not
 * finite neither votes nor receives votes; its flags are 0. */
int tvsgs_votes_vote(tvsgs_votes* votes, const tvsgs_votes_splats* splats, void* stream);

/* Copies the results of the last vote. */
int tvsgs_votes_read(tvsgs_votes* votes, const tvsgs_votes_results* results, void* stream);

/* Index of the handle's GPU; -1: CPU. */
int tvsgs_votes_gpu(const tvsgs_votes* votes);

/* Text of the error of the last call on the handle, "" after success; NULL: of this thread's last failed call without a
 * handle. Valid until the next call on the handle. */
const char* tvsgs_votes_error(const tvsgs_votes* votes);

#ifdef __cplusplus
}
#endif
#endif
