"""Where a bore lies in the patient's CT: the pattern of air on its wall, looked for in the bone around the plan."""
