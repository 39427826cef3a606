"""What an analysis is put together from: the subject, the mass, one check for each question, and the findings."""
