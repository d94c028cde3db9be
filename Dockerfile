# docker build -t casp-drift . && docker run --rm -v "$PWD:/work" --user "$(id -u):$(id -g)" casp-drift run overdue_boat
FROM python:3.13-slim AS base
RUN apt-get update && apt-get install -y --no-install-recommends libx11-6 && rm -rf /var/lib/apt/lists/*
ENV PATH=/opt/drift/bin:$PATH XDG_CACHE_HOME=/opt/cache TI_OFFLINE_CACHE_FILE_PATH=/opt/cache/taichi

FROM base AS build
WORKDIR /src
RUN python -m venv /opt/drift && pip install --no-cache-dir --upgrade pip
COPY pyproject.toml README.md LICENSE ./
COPY drift drift
COPY geo geo
COPY kernels kernels
COPY cases cases
RUN pip install --no-cache-dir '.[serve]'
# The first run compiles kernels and prepares the coast; containers find both.
RUN drift new position /tmp/case.toml \
    && drift run /tmp/case.toml --set particles=1000 --out /tmp/results --quiet \
    && chmod -R a+rwX /opt/cache

FROM base
RUN useradd --create-home drift && mkdir /work && chown drift /work
COPY --from=build /opt /opt
USER drift
WORKDIR /work
ENTRYPOINT ["drift"]
CMD ["--help"]
