"""The paper's studies: each makes its trials, its report and the words for people."""
