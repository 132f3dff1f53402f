"""The paper's filters: PD, DOB, CDOB, the nominal model, and how they become discrete."""
