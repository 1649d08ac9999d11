"""Where units are computed: engines that take a task and give its outcome, and can lose everything but their code."""
