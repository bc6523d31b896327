/* What the sequence numbers of ORIENTATION show: lost, repeated and late samples. For a host or a bridge in C; an
 * object does not need it. */
#ifndef ROTDRIFT_SEQUENCE_H
#define ROTDRIFT_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>

#include "rotdrift_constants.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All zeros is ready for the first number. */
typedef struct {
    uint32_t sequence_gaps;     /* jumps ahead */
    uint32_t samples_lost;      /* numbers jumped over, less those that came late */
    uint32_t duplicates;        /* received once more */
    uint32_t reordered;         /* received after a later one */
    uint32_t sequence_restarts; /* jumps back by more than RD_LATE_WINDOW */
    bool known;                 /* whether newest is one */
    uint16_t newest;
    uint8_t missing[2 * RD_LATE_WINDOW / 8]; /* a bit for each of the last numbers, modulo its size: counted lost */
} rd_sequence;

/* Take the number of one sample, in the order of arrival. */
void rd_sequence_feed(rd_sequence *sequence, uint16_t number);

/* The object was reset: its next number is not compared. The counters go on. */
void rd_sequence_restart(rd_sequence *sequence);

#ifdef __cplusplus
}
#endif

#endif
