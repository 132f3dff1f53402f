/* The controller around a generated law: as controller/node, without a bus, a clock or an allocation.
 *
 *     node_start(&node, now_ns);
 *     node_on_frame(&node, &frame, now_ns);              every frame that arrives
 *     count = node_on_tick(&node, now_ns, frames);       at node.deadline_ns or later; to be sent
 *
 * Not in it: the watch over signals that contradict each other, and authentication.
 */
#ifndef NODE_H
#define NODE_H

#include "model_fit.h"
#include "overruns.h"
#include "reception.h"
#include "steering_law.h"

enum { IN_FLIGHT_MAX = 4096, SENT_MAX = 4 };
enum mode { MODE_WAITING, MODE_ACTIVE, MODE_HOLDING, MODE_SAFE_STOP };
enum freshness { NEVER_SEEN, FRESH, STALE };

struct facts { /* that may have to be reported at once */
    int64_t rejected;
    int ages[3], fault, second_sender, validity, request;
};

struct node {
    int64_t deadline_ns;
    bool has_finished;  /* it cannot steer any more, or the plant has ended; the command is zero */
    bool ends_with_plant;
    bool is_plant_gone;
    struct timer control, status;
    struct overruns overruns;
    struct reception reception;
    /* newest values */
    double lateral_error_m, wheel_rad, speed_m_s;
    int steering;
    bool goes_forward;
    /* the mode table */
    enum mode mode;
    int64_t entered_ns;
    int good_run;
    bool has_own_fault;
    /* the law, and the fade of its commands */
    struct law law;
    struct law_output output;
    double fade_rad, sent_rad;
    bool continues_hold, is_distrusted;
    int failures;
    /* commands sent, and the delay of their echoes */
    int64_t commands, commands_sent_ns[IN_FLIGHT_MAX];
    bool has_echo;
    int64_t echo_ns;
    double echo_mean_ns;
    /* judgement of the vehicle */
    struct motion reported;
    int reported_count;
    int64_t judged_ns;
    struct model_fit fit;
    int validity;
    /* what was reported last */
    bool has_reported;
    struct facts facts;
    int64_t reported_ns;
    uint8_t command_counter, status_counter, safety_counter, delay_counter;
};

void node_start(struct node *x, int64_t start_ns);
void node_on_frame(struct node *x, const struct frame *frame, int64_t now_ns);
int node_on_tick(struct node *x, int64_t now_ns, struct frame frames[SENT_MAX]);

#endif
