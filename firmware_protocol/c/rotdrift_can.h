/* The object's end of a CAN bus, docs/can.md: packets as classic or CAN FD frames, commands out of frames.
 *
 * Nothing here waits. Frames go to a function of the caller, which puts them behind what waits already and returns
 * false where there is no room; what could not be sent is dropped, and the next sample brings the listeners up to date.
 * One rd_can belongs to one context: main loop or interrupt, not both. README.md has an example.
 */
#ifndef ROTDRIFT_CAN_H
#define ROTDRIFT_CAN_H

#include "rotdrift_protocol.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { RD_CAN_MAX_BYTES = 64, RD_CAN_FLOW_CONTROL_US = 250000 };

/* Queue one frame; returns false where there is no room. An id with the bit RD_CAN_WHOLE_PACKET is a CAN FD frame, to
 * be sent with the bit rate switch on; its length is one that CAN FD has. The data are valid during the call only. */
typedef bool (*rd_can_send)(void *context, uint16_t id, const uint8_t *data, uint8_t length);

typedef struct {
    uint8_t node;     /* RD_MIN_NODE to RD_MAX_NODE */
    bool fd;          /* whole packets in CAN FD frames */
    uint8_t boot_tag; /* rd_boot_tag */
    rd_can_send send;
    void *context; /* first argument of send */

    /* What the listeners know of the samples; all zeros: nothing. */
    struct {
        bool known;
        uint8_t flags;
        uint16_t rate_hz;
        uint32_t counter, time_us; /* of the last TIME frame */
    } published;

    /* INFO on its way by ISO-TP; all zeros: none. */
    struct {
        const uint8_t *packet; /* the caller's, until sent */
        uint16_t length, sent;
        uint16_t block; /* frames that may go before the next flow control; 0 waits for it */
        uint8_t sequence, separation;
        uint32_t since_us; /* clock when the last frame came or went */
    } sending;

    uint8_t frame[RD_CAN_MAX_BYTES]; /* where frames are made, to spare the stack */
} rd_can;

/* The eight bits that show a reset, and two objects with one node id: never 0. */
uint8_t rd_boot_tag(uint64_t device_id, uint32_t boot_id);

/* A quaternion in 56 bits: the index of its largest component, then 18 bits for each of the others. False as
 * rd_normalise; code is then that of no orientation. */
bool rd_to_smallest_three(uint64_t *code, const float q[4]);

/* The opposite, w, x, y, z; the component left out comes back positive. False where no quaternion has this code. */
bool rd_from_smallest_three(float q[4], uint64_t code);

/* Send one sample, and before it SAMPLE_STATE and TIME where they are due. The counter counts samples produced since
 * the reset. Where the filter has failed (rd_normalise), a classic frame carries no orientation; in CAN FD nothing is
 * sent. False where the sample itself was not sent: count it as dropped. */
bool rd_can_sample(rd_can *can, uint32_t counter, uint32_t time_us, uint16_t rate_hz, const float q[4], uint8_t flags);

/* Send a packet of rd_encode other than ORIENTATION. INFO must stay where it is until it is sent (sending.packet is
 * NULL); a second one is refused until then. False where the packet was not sent, or not in full. */
bool rd_can_packet(rd_can *can, const uint8_t *packet, size_t n, uint32_t clock_us);

/* Process a frame from the bus with an 11-bit id: a command to this object, or flow control of a host. Returns the
 * length of the command's packet, which is inside data; 0 for everything else. */
size_t rd_can_receive(rd_can *can, uint16_t id, const uint8_t *data, uint8_t length, const uint8_t **packet,
                      uint32_t clock_us);

/* Go on with INFO, or give it up where no host answers. Call it at least every 10 ms. */
void rd_can_poll(rd_can *can, uint32_t clock_us);

#ifdef __cplusplus
}
#endif

#endif
