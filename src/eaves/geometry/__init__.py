"""Points, planes, rings and plans: what several stages compute alike."""
