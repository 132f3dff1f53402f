/* Records on standard input and output of a program. */
#include <stdio.h>

#include "lockstep.h"

int read_record(struct lockstep_record *record)
{
    return fread(record, sizeof *record, 1, stdin) == 1 && LOCKSTEP_IS_SOUND(record);
}

int write_record(const struct lockstep_record *record)
{
    return fwrite(record, sizeof *record, 1, stdout) == 1 && fflush(stdout) == 0;
}
