#include "node.h"

#include <string.h>

#define NS_PER_S 1000000000.0
#define STATUS_PERIOD_NS INT64_C(100000000)
#define SAFETY_INTERVAL_NS INT64_C(20000000)
#define PLANT_ENDED_NS INT64_C(3000000000)

enum { NO_COMMAND, APPLYING, LIMITED, LIMITED_BY_SAFETY, STEERING_HOLDING, FALLBACK, SAFE_STATE };
enum { NO_FAULT, OVERRUNS, LAW_FAILED };
enum { VALIDITY_UNKNOWN, VALID, SPEED_LOW, SPEED_HIGH, DELAY_LONG, MODEL_MISFIT };
enum { NO_REQUEST, SLOW_DOWN, STOP };
enum { COMMAND_COUNTERS = 65536, FAILURES_MAX = 1, SUPERVISED = 3 };
enum { COUNTS_ON_BUS = 4096, SKIPPED_ON_BUS = 256 };

static const double NOT_FORWARD_M_S = 0.1;
static const int64_t AGE_LIMITS_NS[SUPERVISED] = {
    LATERAL_ERROR_AGE_NS, STEERING_STATUS_AGE_NS, VEHICLE_STATE_AGE_NS,
};

static bool is_finite(double x)
{
    return x - x == 0.0;
}

static double clamped(const struct message *message, int signal, double value)
{
    const double high = value_of(message, signal, message->signals[signal].maximum);
    const double low = value_of(message, signal, message->signals[signal].minimum);

    return value < low ? low : value > high ? high : value;
}

void node_start(struct node *x, int64_t start_ns)
{
    memset(x, 0, sizeof *x);
    x->deadline_ns = x->entered_ns = x->judged_ns = start_ns;
    timer_start(&x->control, start_ns, PERIOD_NS);
    timer_start(&x->status, start_ns, STATUS_PERIOD_NS);
    reception_start(&x->reception);
    x->goes_forward = true;
    model_fit_start(&x->fit);
    x->validity = HAS_VALIDITY ? VALID : VALIDITY_UNKNOWN;
}

/* Arrivals */

static bool is_fresh(const struct node *x, int kind, int64_t now_ns)
{
    const struct sequence *newest = &x->reception.checks[kind];

    return newest->has_arrived && now_ns - newest->arrival_ns <= AGE_LIMITS_NS[kind];
}

static void on_echo(struct node *x, int counter, int64_t now_ns)
{
    const int64_t newest = x->commands - 1;
    const int64_t age = ((newest - counter) % COMMAND_COUNTERS + COMMAND_COUNTERS) % COMMAND_COUNTERS;
    double weight = 1.0;

    if (age > newest || age >= IN_FLIGHT_MAX)
        return;
    const int64_t delay_ns = now_ns - x->commands_sent_ns[(newest - age) % IN_FLIGHT_MAX];
    if (x->has_echo && now_ns - x->echo_ns <= STEERING_STATUS_AGE_NS) {
        weight = (double)(now_ns - x->echo_ns) / (double)DELAY_AVERAGING_NS;
        weight = weight < 1.0 ? weight : 1.0;
    }
    x->echo_mean_ns += weight * ((double)delay_ns - x->echo_mean_ns);
    x->has_echo = true;
    x->echo_ns = now_ns;
}

void node_on_frame(struct node *x, const struct frame *frame, int64_t now_ns)
{
    const struct sequence *errors = &x->reception.checks[A_LATERAL_ERROR];
    const bool continues = errors->has_arrived && now_ns - errors->arrival_ns <= LATERAL_ERROR_AGE_NS;
    int32_t raws[SIGNALS_MAX];

    switch (reception_take(&x->reception, frame, now_ns, raws)) {
    case A_LATERAL_ERROR:
        x->lateral_error_m = value_of(&LATERAL_ERROR, LATERAL_ERROR_LATERAL_ERROR_M,
                                      raws[LATERAL_ERROR_LATERAL_ERROR_M]);
        x->good_run = continues ? x->good_run + 1 : 1;
        break;
    case A_STEERING_STATUS:
        x->steering = raws[STEERING_STATUS_STATUS];
        x->wheel_rad = value_of(&STEERING_STATUS, STEERING_STATUS_WHEEL_ANGLE_RAD,
                                raws[STEERING_STATUS_WHEEL_ANGLE_RAD]);
        if (x->steering != NO_COMMAND)
            on_echo(x, raws[STEERING_STATUS_APPLIED_COUNTER], now_ns);
        break;
    case A_VEHICLE_STATE:
        x->speed_m_s = value_of(&VEHICLE_STATE, VEHICLE_STATE_SPEED_M_S,
                                raws[VEHICLE_STATE_SPEED_M_S]);
        x->reported.speed_m_s += x->speed_m_s;
        x->reported.yaw_rate_rad_s += value_of(&VEHICLE_STATE, VEHICLE_STATE_YAW_RATE_RAD_S,
                                               raws[VEHICLE_STATE_YAW_RATE_RAD_S]);
        x->reported.wheel_rad += x->wheel_rad;
        x->reported_count++;
        x->goes_forward = x->speed_m_s >= NOT_FORWARD_M_S;
        break;
    case A_DAMAGED_ERROR:
        x->good_run -= x->good_run > 0 ? 1 : 0;
        break;
    default:
        break;
    }
}

/* Modes: the table of controller/node/modes.py */

static enum mode next_mode(const struct node *x, int64_t now_ns, bool law_failed)
{
    const bool fresh = is_fresh(x, A_LATERAL_ERROR, now_ns);
    const bool is_trusted =
        x->good_run >= RECOVERY_FRAMES && fresh && x->goes_forward && !x->has_own_fault;

    switch (x->mode) {
    case MODE_WAITING:
        return fresh ? MODE_ACTIVE : MODE_WAITING;
    case MODE_ACTIVE:
        if (x->has_own_fault)
            return MODE_SAFE_STOP;
        return law_failed || !fresh || !x->goes_forward ? MODE_HOLDING : MODE_ACTIVE;
    case MODE_HOLDING:
        if (x->has_own_fault)
            return MODE_SAFE_STOP;
        if (is_trusted)
            return MODE_ACTIVE;
        return now_ns - x->entered_ns >= HOLD_NS ? MODE_SAFE_STOP : MODE_HOLDING;
    default:
        return is_trusted ? MODE_ACTIVE : MODE_SAFE_STOP;
    }
}

static void move_on(struct node *x, int64_t now_ns, bool law_failed)
{
    const enum mode before = x->mode, entered = next_mode(x, now_ns, law_failed);

    if (entered == before)
        return;
    x->mode = entered;
    x->entered_ns = now_ns;
    if (entered == MODE_HOLDING)
        x->good_run = 0;
    if (entered == MODE_ACTIVE) {
        law_start(&x->law, x->lateral_error_m);
        x->fade_rad = 0.0;
        /* Before the first command there is no held command to continue from. */
        x->continues_hold = before != MODE_WAITING;
    }
}

/* The law */

/* Which share of its steer the law may ask for at the present speed. */
static double share_of_demand(const struct node *x)
{
    if (!HAS_VALIDITY || x->speed_m_s <= SPEED_TOLERATED_M_S_MAX)
        return 1.0;
    const double ratio = SPEED_M_S_MAX / x->speed_m_s;
    return ratio * ratio;
}

/* Advance the law by one period; returns whether the command it wants is finite. */
static bool law_wants(struct node *x, int64_t now_ns, double *wanted_rad)
{
    const bool is_overruled = x->steering == LIMITED_BY_SAFETY || x->steering == FALLBACK
        || x->steering == SAFE_STATE;
    const bool acts = !is_overruled || !is_fresh(x, A_STEERING_STATUS, now_ns);
    const struct law_output output =
        law_step(&x->law, x->lateral_error_m, acts ? x->sent_rad : x->wheel_rad);
    const double steer_rad = share_of_demand(x) * output.steer_rad;

    if (is_finite(steer_rad)) {
        x->output = output;
        x->fade_rad = difference_step(RAMP_STEP_RAD, x->fade_rad, x->sent_rad, steer_rad,
                                      x->continues_hold);
        x->continues_hold = false;
        *wanted_rad = steer_rad + x->fade_rad;
        if (is_finite(*wanted_rad))
            return true;
    }
    x->is_distrusted = ++x->failures > FAILURES_MAX;
    return false;
}

/* Run the mode table and, if ACTIVE, the law; returns the command before the limits. */
static double wanted(struct node *x, int64_t now_ns)
{
    double wanted_rad = 0.0;

    move_on(x, now_ns, false);
    if (x->mode == MODE_ACTIVE) {
        if (law_wants(x, now_ns, &wanted_rad))
            return wanted_rad;
        x->has_own_fault = x->has_own_fault || x->is_distrusted;
        move_on(x, now_ns, true);
    } else if (x->mode == MODE_SAFE_STOP) {
        return ramp_step(RAMP_STEP_RAD, x->sent_rad);
    }
    return x->sent_rad;
}

/* Reports */

static int fault(const struct node *x)
{
    return x->is_distrusted ? LAW_FAILED : x->overruns.has_failed ? OVERRUNS : NO_FAULT;
}

static struct facts facts_at(const struct node *x, int64_t now_ns)
{
    struct facts facts = {
        .rejected = x->reception.refused, .fault = fault(x), .validity = x->validity,
        .second_sender = reception_second_sender(&x->reception, now_ns), .request = NO_REQUEST,
    };

    for (int i = 0; i < SUPERVISED; i++)
        facts.ages[i] = is_fresh(x, i, now_ns) ? FRESH
            : x->reception.checks[i].has_arrived ? STALE : NEVER_SEEN;
    if (x->validity == SPEED_HIGH || x->validity == DELAY_LONG || x->validity == MODEL_MISFIT)
        facts.request = SLOW_DOWN;
    if (x->mode == MODE_SAFE_STOP || !x->goes_forward || x->steering >= FALLBACK)
        facts.request = STOP;
    return facts;
}

/* Whether CONTROLLER_SAFETY has to leave before its next cycle. */
static bool is_safety_due(const struct node *x, int64_t now_ns)
{
    const struct facts now = facts_at(x, now_ns), *before = &x->facts;
    bool is_worse = now.fault != before->fault || now.request > before->request;
    bool is_other = is_worse || now.rejected != before->rejected || now.request != before->request
        || now.second_sender != before->second_sender || now.validity != before->validity;

    for (int i = 0; i < SUPERVISED; i++) {
        is_other = is_other || now.ages[i] != before->ages[i];
        is_worse = is_worse || (now.ages[i] == STALE && before->ages[i] != STALE);
    }
    return x->has_reported && is_other
        && (is_worse || now_ns - x->reported_ns >= SAFETY_INTERVAL_NS);
}

static struct frame safety_frame(struct node *x, int64_t now_ns)
{
    const struct facts facts = facts_at(x, now_ns);
    const int32_t raws[] = {
        [CONTROLLER_SAFETY_REJECTED] = (int32_t)(facts.rejected % COUNTS_ON_BUS),
        [CONTROLLER_SAFETY_LOST] = (int32_t)(reception_lost(&x->reception) % COUNTS_ON_BUS),
        [CONTROLLER_SAFETY_LATERAL_ERROR_FRESHNESS] = facts.ages[A_LATERAL_ERROR],
        [CONTROLLER_SAFETY_STEERING_STATUS_FRESHNESS] = facts.ages[A_STEERING_STATUS],
        [CONTROLLER_SAFETY_VEHICLE_STATE_FRESHNESS] = facts.ages[A_VEHICLE_STATE],
        [CONTROLLER_SAFETY_FAULT] = facts.fault,
        [CONTROLLER_SAFETY_SECOND_SENDER] = facts.second_sender,
        [CONTROLLER_SAFETY_VALIDITY] = facts.validity,
        [CONTROLLER_SAFETY_MOTION_REQUEST] = facts.request,
    };

    x->facts = facts;
    x->has_reported = true;
    x->reported_ns = now_ns;
    return packed(&CONTROLLER_SAFETY, raws, x->safety_counter++);
}

static struct frame command_frame(struct node *x, int64_t now_ns)
{
    const int32_t raws[] = {
        [STEERING_COMMAND_STEER_RAD] =
            raw_of(&STEERING_COMMAND, STEERING_COMMAND_STEER_RAD, x->sent_rad),
        [STEERING_COMMAND_COMMAND_COUNTER] = (int32_t)(x->commands % COMMAND_COUNTERS),
        [STEERING_COMMAND_MODE] = (int32_t)x->mode,
    };

    x->commands_sent_ns[x->commands % IN_FLIGHT_MAX] = now_ns;
    x->commands++;
    return packed(&STEERING_COMMAND, raws, x->command_counter++);
}

static int32_t estimate_raw(int signal, double value)
{
    return raw_of(&CONTROLLER_STATUS, signal, clamped(&CONTROLLER_STATUS, signal, value));
}

static struct frame status_frame(struct node *x)
{
    const int32_t raws[] = {
        [CONTROLLER_STATUS_MODE] = (int32_t)x->mode,
        [CONTROLLER_STATUS_LAW] = LAW_NUMBER,
        [CONTROLLER_STATUS_DISTURBANCE_RAD] =
            estimate_raw(CONTROLLER_STATUS_DISTURBANCE_RAD, x->output.disturbance_rad),
        [CONTROLLER_STATUS_NETWORK_DISTURBANCE_RAD] = estimate_raw(
            CONTROLLER_STATUS_NETWORK_DISTURBANCE_RAD, x->output.network_disturbance_rad),
        [CONTROLLER_STATUS_SKIPPED_TICKS] = (int32_t)(x->control.skipped % SKIPPED_ON_BUS),
    };

    return packed(&CONTROLLER_STATUS, raws, x->status_counter++);
}

static bool knows_delay(const struct node *x, int64_t now_ns)
{
    return x->has_echo && now_ns - x->echo_ns <= STEERING_STATUS_AGE_NS;
}

static double delay_s(const struct node *x)
{
    const double mean_s = (x->echo_mean_ns - PERIOD_NS / 2.0) / NS_PER_S;

    return mean_s > 0.0 ? mean_s : 0.0;
}

static struct frame delay_frame(struct node *x, int64_t now_ns)
{
    const bool is_known = knows_delay(x, now_ns);
    const int32_t raws[DELAY_STATUS_SIGNALS] = {
        [DELAY_STATUS_ECHO_DELAY_S] = raw_of(&DELAY_STATUS, DELAY_STATUS_ECHO_DELAY_S,
            clamped(&DELAY_STATUS, DELAY_STATUS_ECHO_DELAY_S, is_known ? delay_s(x) : 0.0)),
        [DELAY_STATUS_ECHO_STATE] = is_known,
    };

    return packed(&DELAY_STATUS, raws, x->delay_counter++);
}

static int validity_at(const struct node *x, int64_t now_ns)
{
    const bool knows_speed = x->reception.checks[A_VEHICLE_STATE].has_arrived;

    if (!HAS_VALIDITY)
        return VALIDITY_UNKNOWN;
    if (knows_speed && x->speed_m_s > SPEED_TOLERATED_M_S_MAX)
        return SPEED_HIGH;
    if (knows_delay(x, now_ns) && delay_s(x) > DELAY_S_MAX)
        return DELAY_LONG;
    if (!x->fit.fits)
        return MODEL_MISFIT;
    return knows_speed && x->speed_m_s < SPEED_TOLERATED_M_S_MIN ? SPEED_LOW : VALID;
}

/* Judge by the VEHICLE_STATEs since the last judgement whether the vehicle is the settings'. */
static void judge_vehicle(struct node *x, int64_t now_ns)
{
    const double count = x->reported_count, lasted_s = (double)(now_ns - x->judged_ns) / NS_PER_S;
    const struct motion motion = {
        lasted_s, x->reported.speed_m_s / count, x->reported.yaw_rate_rad_s / count,
        x->reported.wheel_rad / count,
    };
    const struct motion none = {0.0, 0.0, 0.0, 0.0};
    bool is_known = HAS_MODEL_FIT && x->reported_count > 0 && lasted_s > 0.0 && x->goes_forward;

    for (int i = 0; i < SUPERVISED; i++)
        is_known = is_known && now_ns - x->reception.checks[i].arrival_ns <= AGE_LIMITS_NS[i];
    if (is_known)
        model_fit_step(&x->fit, &motion);
    x->reported = none;
    x->reported_count = 0;
    x->judged_ns = now_ns;
}

static int64_t silence_ns(const struct node *x, int64_t now_ns)
{
    int64_t silence = INT64_MAX;

    for (int i = 0; i < SUPERVISED; i++)
        if (x->reception.checks[i].has_arrived && now_ns - x->reception.checks[i].arrival_ns < silence)
            silence = now_ns - x->reception.checks[i].arrival_ns;
    return silence == INT64_MAX ? 0 : silence;
}

int node_on_tick(struct node *x, int64_t now_ns, struct frame frames[SENT_MAX])
{
    bool is_due = false;
    int count = 0;

    if (x->control.deadline_ns <= now_ns) {
        timer_advance(&x->control, now_ns);
        overruns_on_tick(&x->overruns, &x->control);
        x->has_own_fault = x->has_own_fault || x->overruns.has_failed;
        const double wanted_rad = wanted(x, now_ns);
        x->sent_rad = limit_step(&STEER_LIMITS, x->sent_rad, wanted_rad);
        if (x->mode != MODE_WAITING)
            frames[count++] = command_frame(x, now_ns);
        is_due = is_safety_due(x, now_ns);
        x->has_finished = (x->is_plant_gone || fault(x) != NO_FAULT) && x->sent_rad == 0.0;
    }
    if (x->status.deadline_ns <= now_ns) {
        timer_advance(&x->status, now_ns);
        judge_vehicle(x, now_ns);
        x->validity = validity_at(x, now_ns);
        frames[count++] = status_frame(x);
        frames[count++] = safety_frame(x, now_ns);
        frames[count++] = delay_frame(x, now_ns);
        if (x->ends_with_plant && x->sent_rad == 0.0)
            x->is_plant_gone = silence_ns(x, now_ns) >= PLANT_ENDED_NS;
    } else if (is_due) {
        frames[count++] = safety_frame(x, now_ns);
    }
    x->deadline_ns = x->control.deadline_ns < x->status.deadline_ns ? x->control.deadline_ns
                                                                    : x->status.deadline_ns;
    return count;
}
