/* The program around lockstep_exchange: one record in, one record out. */
#include "lockstep.h"

/* Move a whole record; return 0 at the end of the input. Each machine has its own. */
int read_record(struct lockstep_record *record);
int write_record(const struct lockstep_record *record);

int main(void)
{
    static struct lockstep_record record;

    while (read_record(&record)) {
        lockstep_exchange(&record);
        if (!write_record(&record))
            return 1;
    }
    return 0;
}
