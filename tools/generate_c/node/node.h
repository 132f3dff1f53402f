/* The controller around a generated law: as controller/node, but without a bus and a clock.
 *
 *     node_start(&node, now_ns);
 *     node_on_frame(&node, &frame, now_ns);              every frame that others have sent
 *     count = node_on_tick(&node, now_ns, frames);       at node.deadline_ns or later; to be sent
 *
 * Its rules are node_rules.c, generated from Python. Not in it: the watch over signals that
 * contradict each other, and authentication.
 */
#ifndef NODE_H
#define NODE_H

#include "node_rules.h"
#include "steering_law.h"

enum { SENT_MAX = 4, CONTENTS = 128 };

struct reception { /* of one message; a time is INT64_MIN before the first */
    struct counter_state counters;
    struct sender_state senders;
    int64_t arrival_ns;
    int32_t contents[CONTENTS]; /* CRC of the frame with each of the last counters, or -1 */
};

struct node {
    int64_t deadline_ns;
    bool has_failed; /* it steers no more: the command is zero */
    /* time: periods served or skipped since the start */
    int64_t start_ns, control_periods, status_periods, skipped;
    struct overruns overruns;
    uint8_t overran[OVERRUN_WINDOW_TICKS / 8 + 1], missed[MISSED_WINDOW_PERIODS / 8 + 1];
    /* what has been received */
    struct reception received[RECEIVED_COUNT];
    int64_t refused, lost;
    int64_t own_ns, peer_ns; /* when a second sender was noticed, of own messages and of others */
    struct lateral_error error;
    struct steering_status steering;
    struct vehicle_state vehicle;
    /* what is steered */
    struct mode_state modes;
    struct evidence evidence;
    struct law law;
    struct law_output output;
    double fade_rad, sent_rad;
    bool continues_hold, has_lost_rate;
    int failures;
    /* commands sent, and the delay of their echoes */
    int64_t commands, sent_ns[IN_FLIGHT];
    struct echo_mean echoes;
    /* judgement of the vehicle, by sums since the last one */
    double speeds_m_s, yaw_rates_rad_s, wheels_rad, reported;
    int64_t judged_ns, validity;
    struct fit_state fit;
    struct controller_safety facts; /* reported last, at reported_ns */
    int64_t reported_ns;
    uint8_t counters[SENT_MAX];
};

void node_start(struct node *x, int64_t start_ns);
void node_on_frame(struct node *x, const struct frame *frame, int64_t now_ns);
int node_on_tick(struct node *x, int64_t now_ns, struct frame frames[SENT_MAX]);

#endif
