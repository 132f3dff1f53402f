#include "node.h"

#include <string.h>

#define NS_PER_S 1000000000.0
#define NEVER INT64_MIN

enum { COMMAND, STATUS, SAFETY, DELAY, SUPERVISED = 3 };

void node_start(struct node *x, int64_t start_ns)
{
    memset(x, 0, sizeof *x);
    x->deadline_ns = x->start_ns = x->modes.entered_ns = x->judged_ns = start_ns;
    for (int i = 0; i < RECEIVED_COUNT; i++) {
        x->received[i].counters = start_counters(&COUNTER_RULES[i]);
        x->received[i].arrival_ns = NEVER;
        memset(x->received[i].contents, 0xFF, sizeof x->received[i].contents);
    }
    x->own_ns = x->peer_ns = x->echoes.echo_ns = x->evidence.arrival_ns = NEVER;
    x->evidence.goes_forward = true;
    x->fit = start_fit();
    x->validity = DESIGNED_RANGES.is_known ? VALIDITY_VALID : VALIDITY_UNKNOWN;
}

/* Arrivals */

static int64_t freshness_of(const struct node *x, int kind, int64_t now_ns)
{
    return freshness(x->received[kind].arrival_ns, AGE_LIMITS_NS[kind], now_ns);
}

/* Check the counter of an intact frame, and note a second sender by it and the CRC with it. */
static bool is_accepted(struct node *x, const struct reading *it, int64_t now_ns)
{
    struct reception *received = &x->received[it->kind];
    const bool is_first = received->arrival_ns == NEVER;
    const int forward = (uint8_t)(it->counter - (uint8_t)received->senders.newest);
    const bool is_newer = forward > 0 && forward <= COUNTERS / 2;
    const struct counter_step_result checked =
        counter_step(&COUNTER_RULES[it->kind], &received->counters, it->counter, now_ns);
    int32_t *place = &received->contents[it->counter % CONTENTS];

    x->lost += checked.first.lost - received->counters.lost;
    received->counters = checked.first;
    if (checked.second == COUNTER_RESULT_ACCEPTED)
        received->arrival_ns = now_ns;
    for (int skipped = 1; is_newer && skipped < forward; skipped++)
        received->contents[(it->counter + COUNTERS - skipped) % CONTENTS] = -1;
    const int32_t known = is_first || is_newer ? -1 : *place;
    *place = it->crc;
    if (is_first)
        received->senders = start_senders(it->counter, now_ns);
    if (!is_first && known != it->crc) {
        const struct sender_step_result watched =
            sender_step(COUNTERS, &received->senders, it->counter, known != -1, now_ns);

        received->senders = watched.first;
        x->peer_ns = watched.second ? now_ns : x->peer_ns;
    }
    return checked.second == COUNTER_RESULT_ACCEPTED;
}

static void on_echo(struct node *x, int64_t now_ns)
{
    int64_t age = echoed_age(x->commands, x->steering.applied_counter);

    if (x->steering.status == STEERING_STATUS_CODE_NO_COMMAND || age == NEVER)
        return;
    if (age >= IN_FLIGHT) /* it is longer ago than any that is kept */
        age = IN_FLIGHT - 1;
    const int64_t sent_ns = x->sent_ns[(x->commands - 1 - age) % IN_FLIGHT];
    x->echoes = echo_step(&ECHO_RULE, &x->echoes, sent_ns, now_ns);
}

void node_on_frame(struct node *x, const struct frame *frame, int64_t now_ns)
{
    const struct reading it = reading_of(frame);

    if (it.kind == AN_OWN_MESSAGE)
        x->own_ns = now_ns;
    x->refused += it.kind == AN_OWN_MESSAGE ? 1 : 0;
    if (it.kind >= RECEIVED_COUNT)
        return;
    const int64_t before_ns = x->received[it.kind].arrival_ns;
    if (!it.is_intact || !is_accepted(x, &it, now_ns)) {
        x->refused++;
        if (it.kind == A_LATERAL_ERROR && it.is_damaged)
            x->modes.good_run = damaged_run(x->modes.good_run);
    } else if (it.kind == A_LATERAL_ERROR) {
        x->error = it.lateral_error;
        x->modes.good_run = measured_run(&SUPERVISION, x->modes.good_run, before_ns, now_ns);
        x->evidence.arrival_ns = now_ns;
    } else if (it.kind == A_STEERING_STATUS) {
        x->steering = it.steering_status;
        on_echo(x, now_ns);
    } else if (it.kind == A_VEHICLE_STATE) {
        x->vehicle = it.vehicle_state;
        x->speeds_m_s += x->vehicle.speed_m_s;
        x->yaw_rates_rad_s += x->vehicle.yaw_rate_rad_s;
        x->wheels_rad += x->steering.wheel_angle_rad;
        x->reported += 1.0;
        x->evidence.goes_forward = x->vehicle.speed_m_s >= NOT_FORWARD_M_S;
    }
}

/* The command */

/* Put a bit into a ring; returns the one in its place. */
static int replaced(uint8_t *ring, int64_t index, bool value)
{
    const int bit = (int)(index % 8), left = ring[index / 8] >> bit & 1;

    ring[index / 8] = (uint8_t)((ring[index / 8] & ~(1 << bit)) | value << bit);
    return left;
}

/* Process the periods missed before a tick. */
static void supervise(struct node *x, int64_t missed)
{
    const int64_t counted = counted_periods(&OVERRUN_RULE, missed);
    const int64_t tick = x->overruns.ticks % OVERRUN_WINDOW_TICKS;
    const int overruns_left = replaced(x->overran, tick, counted > 0);
    int64_t missed_left = 0;

    for (int64_t i = 0; i <= counted; i++)
        missed_left +=
            replaced(x->missed, (x->overruns.periods + i) % MISSED_WINDOW_PERIODS, i > 0);
    x->overruns = overrun_step(&x->overruns, counted, overruns_left, missed_left);
    x->has_lost_rate = x->has_lost_rate || !keeps_rate(&OVERRUN_RULE, &x->overruns);
}

static int64_t fault(const struct node *x)
{
    return x->failures > LAW_FAILURES_MAX ? CONTROLLER_FAULT_LAW_FAILED
        : x->has_lost_rate ? CONTROLLER_FAULT_OVERRUNS : CONTROLLER_FAULT_NONE;
}

static void move_on(struct node *x, int64_t now_ns, bool law_failed)
{
    const int64_t before = x->modes.mode;

    x->evidence.law_failed = law_failed;
    x->evidence.own_fault = fault(x) != CONTROLLER_FAULT_NONE;
    x->modes = mode_step(&SUPERVISION, &x->modes, &x->evidence, now_ns);
    if (x->modes.mode == before || x->modes.mode != MODE_ACTIVE)
        return;
    law_start(&x->law, x->error.lateral_error_m);
    x->fade_rad = 0.0;
    x->continues_hold = before != MODE_WAITING; /* before the first command there is none held */
}

/* Advance the law by one period; returns the command that it wants, which may not be finite. */
static double law_wants(struct node *x, int64_t now_ns)
{
    const int64_t age = freshness_of(x, A_STEERING_STATUS, now_ns);
    const double acts_rad =
        acting_rad(x->steering.status, age, x->steering.wheel_angle_rad, x->sent_rad);
    const struct vehicle_reading vehicle = {
        x->vehicle.speed_m_s, x->vehicle.yaw_rate_rad_s, x->vehicle.preview_curvature_1_m,
        freshness_of(x, A_VEHICLE_STATE, now_ns) == FRESHNESS_STALE,
    };
    const struct law_output output =
        law_step(&x->law, x->error.lateral_error_m, acts_rad, &vehicle);
    const double steer_rad =
        share_of_demand(&DESIGNED_RANGES, x->vehicle.speed_m_s) * output.steer_rad;

    if (steer_rad - steer_rad != 0.0)
        return steer_rad;
    x->output = output;
    x->fade_rad =
        difference_step(RAMP_STEP_RAD, x->fade_rad, x->sent_rad, steer_rad, x->continues_hold);
    x->continues_hold = false;
    return steer_rad + x->fade_rad;
}

/* Run the mode table and, if ACTIVE, the law; returns the command before the limits. */
static double wanted(struct node *x, int64_t now_ns)
{
    move_on(x, now_ns, false);
    if (x->modes.mode == MODE_SAFE_STOP)
        return ramp_step(RAMP_STEP_RAD, x->sent_rad);
    if (x->modes.mode != MODE_ACTIVE)
        return x->sent_rad;
    const double wanted_rad = law_wants(x, now_ns);
    if (wanted_rad - wanted_rad == 0.0)
        return wanted_rad;
    x->failures++;
    move_on(x, now_ns, true);
    return x->sent_rad;
}

/* Reports */

static struct controller_safety facts_at(const struct node *x, int64_t now_ns)
{
    return facts_of(x->refused, freshness_of(x, A_LATERAL_ERROR, now_ns),
                    freshness_of(x, A_STEERING_STATUS, now_ns),
                    freshness_of(x, A_VEHICLE_STATE, now_ns), fault(x),
                    second_sender_at(x->own_ns, x->peer_ns, now_ns), x->validity, x->modes.mode,
                    x->evidence.goes_forward, x->steering.status);
}

static struct frame safety_frame(struct node *x, int64_t now_ns)
{
    x->facts = facts_at(x, now_ns);
    x->reported_ns = now_ns;
    struct controller_safety safety = x->facts;

    safety.lost = x->lost % LOST_COUNTERS;
    return controller_safety_frame(&safety, x->counters[SAFETY]++);
}

/* Judge by the VEHICLE_STATEs since the last judgement whether the vehicle is the settings'. */
static void judge_vehicle(struct node *x, int64_t now_ns, double delay_s)
{
    const double count = x->reported, lasted_s = (double)(now_ns - x->judged_ns) / NS_PER_S;
    const bool knows_speed = x->received[A_VEHICLE_STATE].arrival_ns != NEVER;
    bool is_known = HAS_MODEL_FIT && count > 0.0 && lasted_s > 0.0 && x->evidence.goes_forward;

    for (int i = 0; i < SUPERVISED; i++)
        is_known = is_known && freshness_of(x, i, now_ns) == FRESHNESS_FRESH;
    if (is_known)
        x->fit = fit_step(&FIT_PARAMS, &x->fit, lasted_s, x->speeds_m_s / count,
                          x->yaw_rates_rad_s / count, x->wheels_rad / count);
    x->speeds_m_s = x->yaw_rates_rad_s = x->wheels_rad = x->reported = 0.0;
    x->judged_ns = now_ns;
    x->validity = validity_of(&DESIGNED_RANGES, knows_speed ? x->vehicle.speed_m_s : 0.0 / 0.0,
                              delay_s, x->fit.fits);
}

/* Serve the period that is due; returns how many before it were not served. */
static int64_t served(int64_t *periods, int64_t since_start_ns, int64_t period_ns)
{
    const int64_t missed = since_start_ns / period_ns - *periods;

    *periods += missed + 1;
    return missed;
}

int node_on_tick(struct node *x, int64_t now_ns, struct frame frames[SENT_MAX])
{
    const int64_t since_ns = now_ns - x->start_ns;
    bool is_due = false;
    int count = 0;

    if (x->control_periods * PERIOD_NS <= since_ns) {
        const int64_t missed = served(&x->control_periods, since_ns, PERIOD_NS);

        x->skipped += missed;
        supervise(x, missed);
        x->sent_rad = limit_step(&STEER_LIMITS, x->sent_rad, wanted(x, now_ns));
        if (x->modes.mode != MODE_WAITING) {
            const struct steering_command command = {
                x->sent_rad, x->commands % COMMAND_COUNTERS, x->modes.mode,
            };

            x->sent_ns[x->commands++ % IN_FLIGHT] = now_ns;
            frames[count++] = steering_command_frame(&command, x->counters[COMMAND]++);
        }
        const struct controller_safety facts = facts_at(x, now_ns);
        is_due = is_report_due(&facts, &x->facts, now_ns - x->reported_ns);
        x->has_failed = fault(x) != CONTROLLER_FAULT_NONE && x->sent_rad == 0.0;
    }
    if (x->status_periods * STATUS_PERIOD_NS <= since_ns) {
        const double delay_s = echo_delay_s(&ECHO_RULE, &x->echoes, now_ns);
        const struct delay_status delay = delay_status(delay_s);
        const struct controller_status status =
            controller_status(x->modes.mode, LAW_NUMBER, x->output.disturbance_rad,
                              x->output.network_disturbance_rad, x->skipped);

        served(&x->status_periods, since_ns, STATUS_PERIOD_NS);
        judge_vehicle(x, now_ns, delay_s);
        frames[count++] = controller_status_frame(&status, x->counters[STATUS]++);
        frames[count++] = safety_frame(x, now_ns);
        frames[count++] = delay_status_frame(&delay, x->counters[DELAY]++);
    } else if (is_due) {
        frames[count++] = safety_frame(x, now_ns);
    }
    const int64_t control_ns = x->control_periods * PERIOD_NS;
    const int64_t status_ns = x->status_periods * STATUS_PERIOD_NS;
    x->deadline_ns = x->start_ns + (control_ns < status_ns ? control_ns : status_ns);
    return count;
}
