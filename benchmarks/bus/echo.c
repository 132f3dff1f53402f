/* echo CHANNEL REQUEST_ID REPLY_ID: answers every frame with its payload, as fast as C can. */
#include "yardstick.h"

int main(int count, char **arguments)
{
    if (count != 4)
        die("echo CHANNEL REQUEST_ID REPLY_ID");
    canid_t request_id = (canid_t)number(arguments[2]), reply_id = (canid_t)number(arguments[3]);
    int bus = open_can(arguments[1], request_id, CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG);
    struct can_frame frame;
    prepare();
    say_ready();
    while (read(bus, &frame, sizeof frame) == (ssize_t)sizeof frame) {
        frame.can_id = reply_id;
        if (write(bus, &frame, sizeof frame) != (ssize_t)sizeof frame)
            die("write");
    }
    die("read");
}
