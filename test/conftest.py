from hypothesis import HealthCheck, settings

# A loaded machine is no failure: nothing here judges by the wall clock.
settings.register_profile("without_clock", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("without_clock")
