"""Operations: what tailstack computes for people and programs, each written in one place."""
