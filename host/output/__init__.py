"""The only way to the terminal: whatever is printed goes through here, without what a terminal would act on."""
