"""The prefill in the forms that other libraries read; one module a form, and none needs its library to be written."""
