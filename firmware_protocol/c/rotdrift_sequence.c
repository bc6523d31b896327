#include "rotdrift_sequence.h"

enum { REMEMBERED = 2 * RD_LATE_WINDOW };

/* Note whether a number is missing; returns whether it was. */
static bool note(rd_sequence *sequence, uint16_t number, bool is_missing)
{
    uint8_t *byte = &sequence->missing[number % REMEMBERED / 8];
    const uint8_t bit = (uint8_t)(1u << number % 8);
    const bool was_missing = (*byte & bit) != 0;
    *byte = (uint8_t)(is_missing ? *byte | bit : *byte & ~bit);
    return was_missing;
}

void rd_sequence_restart(rd_sequence *sequence)
{
    sequence->known = false;
    for (unsigned k = 0; k < REMEMBERED; k++)
        note(sequence, (uint16_t)k, false);
}

void rd_sequence_feed(rd_sequence *sequence, uint16_t number)
{
    const int32_t ahead = (int16_t)(uint16_t)(number - sequence->newest);
    if (!sequence->known) {
        sequence->known = true;
    } else if (ahead > 0) {
        /* Those jumped over are missing. Only the bits of the last REMEMBERED numbers exist; each number passed sets
         * its own, so that none of an older number is left in its place. */
        const int32_t skipped = ahead - 1;
        int32_t step = skipped > REMEMBERED ? skipped - REMEMBERED : 0;
        sequence->sequence_gaps += skipped > 0;
        sequence->samples_lost += (uint32_t)skipped;
        while (++step <= skipped)
            note(sequence, (uint16_t)(sequence->newest + step), true);
        note(sequence, number, false);
    } else if (ahead < -RD_LATE_WINDOW) {
        rd_sequence_restart(sequence);
        sequence->known = true;
        sequence->sequence_restarts++;
    } else {
        if (note(sequence, number, false)) {
            sequence->reordered++;
            sequence->samples_lost--;
        } else {
            sequence->duplicates++;
        }
        return;
    }
    sequence->newest = number;
}
