# make compare   run the estimators on the bundled example; results in runs/example
# make test      run the tests        make check   linter, formatter, types, layers
# make test-quick   the tests of models, state, files and interfaces, for the edit loop
# make docs      the site of docs/ in build/site, strict
# make bench     time the estimators, tell changes of 10 %   make clean   remove everything but results
# make pictures  draw the pictures of README again, into docs   make release   the pictures, then the source distribution in dist
# make core-types   run the tests that depend on arithmetic under other core types of OpenBLAS, and without compiled code
# make kernels   the same by its former name
# Every target installs what it needs into .venv, once. Choose another Python with PYTHON=python3.12.

.PHONY: compare test test-quick core-types kernels check docs bench pictures release clean
.NOTPARALLEL:

bin := .venv/bin
environment := @PYTHON='$(PYTHON)' sh .ci/environment.sh

# small matrices gain nothing from threads, and results and times are steadier without
export OMP_NUM_THREADS ?= 1
# a worker of the tests for every processor, up to eight: more would wait for one another's memory; WORKERS=2 leaves the others free
WORKERS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2); echo $$((n < 8 ? n : 8)))
in_parallel = -n $(WORKERS) --dist worksteal
# packages of another installation (ROS, say) must not shadow those of .venv
unexport PYTHONPATH PYTHONHOME

compare:
	$(environment)
	@$(bin)/spinfilters compare -o runs/example

test:
	$(environment) test
	@$(bin)/python -m pytest $(in_parallel)

quick := $(addprefix tests/,api core io models plots simulation test_repository.py)

test-quick:
	$(environment) test
	@$(bin)/python -m pytest -q $(in_parallel) $(quick)

docs:
	$(environment) docs
	@$(bin)/python -m spinfilters.verdict.checks_page docs/reference/checks.md
	@$(bin)/python -m spinfilters.cli.commands_page docs/reference/commands.md
	@$(bin)/python -m spinfilters.settings.settings_page docs/reference/settings.md
	@NO_MKDOCS_2_WARNING=1 $(bin)/mkdocs build --quiet --config-file .mkdocs.yml
	@echo build/site/index.html

# The tests whose outcome depends on arithmetic; of the analyser those of its exact ranks, symmetries and words have none in floats.
exact := $(addprefix tests/observability/test_,analyser_input.py analyser_readme.py discrete_symmetries.py function_values.py generators.py \
  hostile_models.py invariants.py model_rank.py new_systems.py null_vectors.py observability_page.py power_series.py prime_field.py \
  scope.py symmetries.py)
numeric := $(addprefix tests/,core filters models simulation smoother test_blas_core_types.py \
  $(addprefix inference/test_,identification.py initial_estimate.py initialiser_faults.py masked_errors.py) \
  $(addprefix verdict/test_,alternatives.py calibration_sensitivity.py correlated_errors.py epoch_information.py error_size.py \
  inspector_alternatives.py laplace_likelihood.py model_errors.py null_distributions.py)) \
  $(filter-out $(exact) tests/evaluation/test_metric_table.py,$(wildcard tests/observability/test_*.py tests/evaluation/test_*.py))

# Whole recordings that are solved many times take five to eight times as long when nothing is compiled. What they are made of is run
# without compiled code by the other tests of their room.
whole := $(addprefix tests/smoother/test_,early_epochs.py mass_posterior.py posterior.py)
interpreted := $(filter-out $(whole),$(foreach each,$(numeric),$(if $(filter %.py,$(each)),$(each),$(wildcard $(each)/test_*.py))))

# Rooms that factor no matrix of a whole recording: what hangs on rounding in them shows under one other core type as under two.
small := $(addprefix tests/,core models simulation)

# Every core type but the last with compiled code, the last without but for whole recordings: what passes by rounding in one of both fails
# there, too. Whole recordings are solved under each with compiled code, and once more only where the last is the one core type.
# The former name of the target is kernels; a kernel is a compiled loop of ours.
kernels: core-types

core-types:
	$(environment) test
	@status=0; types=$$($(bin)/python tests/blas_core_types.py) || exit 1; \
	set -- $$types; solved=no; \
	while [ $$# -gt 1 ]; do \
	  echo "numeric tests, OpenBLAS' core type $$1:"; \
	  OPENBLAS_CORETYPE=$$1 $(bin)/python -m pytest -q $(in_parallel) $(filter-out $(small),$(numeric)) || status=1; \
	  shift; solved=yes; \
	done; \
	echo "numeric tests, nothing compiled$${1:+, OpenBLAS' core type $$1}:"; \
	env SPINFILTERS_COMPILE=off $${1:+OPENBLAS_CORETYPE=$$1} $(bin)/python -m pytest -q $(in_parallel) $(interpreted) || status=1; \
	if [ $$solved = no ]; then \
	  echo "whole recordings$${1:+, OpenBLAS' core type $$1}:"; \
	  env $${1:+OPENBLAS_CORETYPE=$$1} $(bin)/python -m pytest -q $(in_parallel) $(whole) || status=1; \
	fi; \
	exit $$status

check:
	$(environment) test,check
	@status=0; \
	$(bin)/ruff check || status=1; \
	$(bin)/ruff format --check || status=1; \
	$(bin)/basedpyright --pythonpath $(bin)/python || status=1; \
	$(bin)/lint-imports --no-logo || status=1; \
	exit $$status

bench:
	$(environment)
	@$(bin)/python -m experiments.benchmarks.timing_history
	@$(bin)/python -m experiments.benchmarks.filter_speed
	@$(bin)/python -m experiments.benchmarks.landmark_filters --frames 1000
	@$(bin)/python -m experiments.benchmarks.observability_speed
	@$(bin)/python -m experiments.benchmarks.smoother --motion rich --repeats 3

pictures:
	$(environment)
	@$(bin)/python -m experiments.readme_pictures -o docs

release: pictures
	$(environment) test
	@$(bin)/python -c "from setuptools.build_meta import build_sdist; print('dist/' + build_sdist('dist'))"

clean:
	rm -rf .venv build dist spinfilters.egg-info .ruff_cache .hypothesis .pytest_cache .import_linter_cache
	find spinfilters experiments tests -name __pycache__ -type d -prune -exec rm -rf {} +
