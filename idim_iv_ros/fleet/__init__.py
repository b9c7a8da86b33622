"""A fleet: many bags of many robots, one small result a bag, one answer for all."""
